"""ngspice on the circuits, from their netlists in its own language. It has no ideal diode: that of the emission coefficient
0.01 has a forward voltage of some millivolts and a capacitance of 10 pF, and its error cannot fall below what these make."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from common import LONGEST, main

DIODE = ".model ideal D(IS=1e-12 N=0.01 CJO=10p)\n"
BRIDGE = "C1 a 0 1u IC=10\nL1 a 0 10m IC=0\nD1 0 p ideal\nD2 n 0 ideal\nD3 a p ideal\nD4 n a ideal\nR1 p n 1k\n"
FILTER = ("C1 a 0 1u IC={v}\nL1 a 0 10m IC=0\nD1 0 p ideal\nD2 n 0 ideal\nD3 a p ideal\nD4 n a ideal\nR1 p n 1k\n"
          "C2 p n 300n IC={v}\n")
RECTIFIER = "V1 in 0 SIN(0 10 50)\nD1 in a ideal\nR1 a b 10\nL1 b 0 20m IC=0\n"
BUCK = ("V1 in 0 12\nVC c 0 PULSE(1 0 3.99e-6 2e-8 2e-8 1.198e-5 2e-5)\nS1 in x c 0 ideal_switch\n"
        ".model ideal_switch SW(VT=0.5 VH=0 RON=1u ROFF=1g)\nD1 0 x ideal\nL1 x out 100u IC=0\nC1 out 0 10u IC=0\nR1 out 0 2\n")

# For each test system its netlist, and for each output of the system the name of its vector in
# ngspice.
SYSTEMS = {
    "rectifier": (RECTIFIER, {"i": "i(L1)"}),
    "diode_bridge": (BRIDGE, {"v": "v(a)", "i": "i(L1)"}),
    "diode_bridge_dvi": (BRIDGE, {"v": "v(a)", "i": "i(L1)"}),
    "diode_bridge_netlist": (BRIDGE, {"v(C1)": "v(a)", "i(L1)": "i(L1)"}),
    "diode_bridge_filter": (FILTER.format(v=100 / 13), {"v": "v(a)", "i": "i(L1)", "v_filter": "v(p)-v(n)"}),
    "buck_converter": (BUCK, {"v(C1)": "v(out)", "i(L1)": "i(L1)"}),
}


def name():
    import numpy

    assert numpy
    told = subprocess.run([shutil.which("ngspice"), "--version"], capture_output=True, text=True, check=True).stdout
    return "ngspice " + re.search(r"ngspice-(\S+)", told)[1]


def transient(request, rtol):
    netlist, outputs = SYSTEMS[request["system"]]
    end = request["times"][-1]
    folder = tempfile.TemporaryDirectory()
    deck, data = Path(folder.name, "deck.cir"), Path(folder.name, "out.txt")
    vectors = " ".join(outputs.values())
    deck.write_text(
        f"{request['system']}\n{DIODE}{netlist}"
        f".options reltol={rtol} abstol={rtol * 1e-9} vntol={rtol * 1e-3} chgtol={rtol * 1e-11} method=gear maxord=2 trtol=1\n"
        f".control\nset wr_singlescale\nset numdgt=15\noption noinit\ntran {end / 1000:.17g} {end:.17g} 0 {end / 50:.17g} uic\n"
        f"rusage trantime\nwrdata {data} {vectors}\nquit\n.endc\n.end\n"
    )

    import numpy as np

    def solve():
        told = subprocess.run(["ngspice", "-b", str(deck)], capture_output=True, text=True, timeout=1.5 * LONGEST)
        if not data.exists():
            raise RuntimeError((told.stderr or told.stdout)[-150:].replace("\n", " "))
        table = np.loadtxt(data)
        data.unlink()
        if table[-1, 0] < end * (1 - 1e-9):
            raise RuntimeError(f"no step beyond t = {table[-1, 0]:.3e}")
        fields = {name: np.interp(request["times"], table[:, 0], table[:, k + 1]) for k, name in enumerate(outputs)}
        spent = re.search(r"[Tt]ran\w* time\D*([\d.eE+-]+)", told.stdout)
        found = {"fields": fields, "steps": len(table), "folder": folder}
        # ngspice measures its computing time in milliseconds: a shorter run is measured as the
        # time of the whole process.
        return found | ({"seconds": float(spent[1])} if spent and float(spent[1]) > 0 else {})

    return solve


def systems(request):
    return [("ngspice, Gear 2", "rtol", transient)] if request["system"] in SYSTEMS else []


if __name__ == "__main__":
    main(name, "ngspice\ntests/peers/install, or: apt install ngspice", systems)
