"""Smooth systems of the examples as expressions of SymPy: rates, Jacobian, tolerances, for the peers that solve them.

The pendulum, of index two here, is posed to others with its index reduced: the tension from the second derivative of the
constraint. That is the kindest form of it.
"""

import sympy

NAMES = ("robertson", "van_der_pol", "hires", "pollu", "pendulum", "diode_bridge", "diode_bridge_dvi", "diode_bridge_netlist")
FUNCTIONS = {"pi": sympy.pi}


class Smooth:
    def __init__(self, request):
        system, document = request["system"], request["specification"]
        self.request, self.end = request, document["time"]["end"]
        if system.startswith("diode_bridge"):
            self.bridge(request)
        else:
            self.expressions(system, document["problem"]["dvi"])
        method = document.get("method", {})
        self.rtol = method.get("rtol", 1e-6)
        atol = method.get("atol", self.rtol)
        self.atol = [atol[name] if isinstance(atol, dict) else atol for name in self.names]
        self.jacobian = sympy.Matrix(self.rates).jacobian(self.states)

    def bridge(self, request):
        """Four ideal diodes on a resonant circuit: its states obey a linear equation without switches."""
        self.names = {"diode_bridge_netlist": ["v(C1)", "i(L1)"]}.get(request["system"], ["v", "i"])
        v, i = self.states = sympy.symbols("v i")
        self.rates = [-1e6 * i - 1e3 * v, 100 * v]
        self.initial = [10.0, 0.0]
        self.extra = {}

    def expressions(self, system, problem):
        self.names = list(problem["states"])
        self.states = sympy.symbols(self.names)
        scope = dict(FUNCTIONS, **dict(zip(self.names, self.states)))
        for name, value in problem.get("parameters", {}).items():
            scope[name] = sympy.sympify(str(value).replace("^", "**"), locals=scope)
        self.extra = {}
        if system == "pendulum":
            x, y, u, v = self.states
            scope["tension"] = (u**2 + v**2 - scope["g"] * y) / (x**2 + y**2)
            self.extra = {"tension": scope["tension"]}
        rates = [str(state["rate"]).replace("^", "**") for state in problem["states"].values()]
        self.rates = [sympy.sympify(rate, locals=scope) for rate in rates]
        self.initial = [float(state["initial"]) for state in problem["states"].values()]

    def tolerances(self, rtol):
        """Absolute tolerances go along with the relative one, as they do in the report."""
        return [atol * rtol / self.rtol for atol in self.atol]
