"""RADAU5 of Hairer and Wanner, the compiled Fortran as R's package deSolve has it, with rates and Jacobian in C: the fair peer of
a compiled solver on smooth stiff systems."""

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

from common import LONGEST, main

RUN = """
suppressMessages(library(deSolve))
dyn.load("{library}")
y0 <- c({initial}); atol <- c({atol}); times <- c(0, {times})
solve <- function() radau(y0, times, func = "rates", jacfunc = "slopes", jactype = "fullusr", dllname = "model", parms = NULL,
                          rtol = {rtol}, atol = atol, maxsteps = 1000000, verbose = FALSE, initfunc = NULL, nout = 0)
found <- solve()
if (nrow(found) < length(times) || any(!is.finite(found))) stop("it did not reach the end")
# Measures the wall-clock time of each repeated solve within R: the time includes the call of the
# compiled code from R, a fraction of a millisecond.
seconds <- sapply(1:{repeats}, function(k) {{ start <- as.numeric(Sys.time()); solve(); as.numeric(Sys.time()) - start }})
steps <- attr(found, "istate")[2]
rows <- apply(found[-1, -1, drop = FALSE], 1, function(row) paste0("[", paste(sprintf("%.17g", row), collapse = ","), "]"))
cat(sprintf('{{"y":[%s],"seconds":%.17g,"steps":%d}}', paste(rows, collapse = ","), median(seconds), as.integer(steps)))
"""


def name():
    import smooth  # Checks that SymPy is installed.

    assert smooth and shutil.which("gcc")
    told = subprocess.run([shutil.which("Rscript"), "-e", 'cat(as.character(packageVersion("deSolve")))'], capture_output=True, text=True, check=True)
    return f"RADAU5 (deSolve {told.stdout.strip()})"


def source(system):
    """Rates and Jacobian in C, common subexpressions shared; the Jacobian by columns."""
    import sympy

    places = {state: sympy.Symbol(f"y[{k}]") for k, state in enumerate(system.states)}
    size = len(system.states)

    def body(expressions, target):
        shared, left = sympy.cse([sympy.sympify(one).subs(places) for one in expressions])
        lines = [f"  double {symbol} = {sympy.ccode(value)};" for symbol, value in shared]
        return "\n".join(lines + [f"  {target}[{k}] = {sympy.ccode(value)};" for k, value in enumerate(left)])

    columns = [system.jacobian[row, column] for column in range(size) for row in range(size)]
    return (
        "#include <math.h>\n"
        "void rates(int *n, double *t, double *y, double *dy, double *out, int *ip) {\n" + body(system.rates, "dy") + "\n}\n"
        "void slopes(int *n, double *t, double *y, int *ml, int *mu, double *pd, int *rows, double *out, int *ip) {\n"
        + body(columns, "pd") + "\n}\n"
    )


def compiled(request, rtol):
    from smooth import Smooth

    system = Smooth(request)
    folder = tempfile.TemporaryDirectory()
    model, library, script = (Path(folder.name, file) for file in ("model.c", "model.so", "run.R"))
    model.write_text(source(system))
    subprocess.run(["gcc", "-O3", "-march=native", "-shared", "-fPIC", "-o", library, model, "-lm"], check=True, timeout=LONGEST * 2)
    numbers = lambda values: ", ".join(map(repr, values))
    script.write_text(RUN.format(library=library, initial=numbers(system.initial), atol=numbers(system.tolerances(rtol)),
                                 times=numbers(request["times"]), rtol=repr(rtol), repeats=request["repeats"]))
    kept = {}

    def solve():
        if not kept:
            told = subprocess.run(["Rscript", "--vanilla", str(script)], capture_output=True, text=True, timeout=1.5 * LONGEST)
            if not told.stdout.startswith("{"):
                raise RuntimeError((told.stderr or told.stdout).strip()[-150:].replace("\n", " "))
            kept.update(json.loads(told.stdout), folder=folder)
        return {"fields": dict(zip(system.names, zip(*kept["y"]))), "steps": kept["steps"], "seconds": kept["seconds"]}

    return solve


def systems(request):
    from smooth import NAMES

    return [("RADAU5", "rtol", compiled)] if request["system"] in NAMES else []


if __name__ == "__main__":
    main(name, "RADAU5\ntests/peers/install, or: apt install r-cran-desolve gcc; python3 -m pip install sympy", systems)
