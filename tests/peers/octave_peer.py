"""Octave: ode15s (SUNDIALS' variable-order methods) with analytic Jacobians, and lsode, on the smooth systems."""

import json
import shutil
import subprocess

from common import LONGEST, main

PROGRAM = """
1;
function dy = rates(t, y)
  dy = [{rates}];
end
function [jy, jdy] = slopes(t, y, dy)
  jy = [{jacobian}];
end
function j = jacobian(t, y)
  j = [{jacobian}];
end
y0 = [{initial}]; atol = [{atol}]; times = [0, {times}];
warning("off", "all");
function [y, steps] = solve(method, y0, times, rtol, atol)
  if strcmp(method, "ode15s")
    options = odeset("RelTol", rtol, "AbsTol", atol, "Jacobian", @jacobian, "InitialStep", 1e-9);
    [t, y] = ode15s(@rates, times, y0, options);
    if numel(t) < numel(times) error("ended at t = %g", t(end)); end
    steps = 0;
  else
    lsode_options("relative tolerance", rtol); lsode_options("absolute tolerance", atol);
    lsode_options("integration method", "stiff"); lsode_options("step limit", 1000000);
    [y, state, message] = lsode({{@(y, t) rates(t, y), @(y, t) jacobian(t, y)}}, y0, times);
    if state != 2 error(message); end
    steps = 0;
  end
end
[y, steps] = solve("{method}", y0, times, {rtol}, atol);
seconds = [];
for k = 1:{repeats}
  clock = tic; solve("{method}", y0, times, {rtol}, atol); seconds(end + 1) = toc(clock);
end
printf("%s", jsonencode(struct("y", y(2:end, :), "seconds", median(seconds), "steps", steps)));
"""


def name():
    import smooth  # Checks that SymPy is installed.

    assert smooth
    told = subprocess.run([shutil.which("octave-cli"), "--version"], capture_output=True, text=True, check=True).stdout
    return "Octave " + told.split("version ")[1].split()[0] + " (ode15s, lsode)"


def session(method):
    def prepare(request, rtol):
        import sympy

        from smooth import Smooth

        system = Smooth(request)
        places = {state: sympy.Symbol(f"y({k + 1})") for k, state in enumerate(system.states)}
        code = lambda expression: sympy.octave_code(expression.subs(places))
        rows = ["\n".join([", ".join(code(entry) for entry in row)]) for row in system.jacobian.tolist()]
        text = PROGRAM.format(
            rates="; ".join(code(rate) for rate in system.rates), jacobian="; ".join(rows),
            initial="; ".join(map(repr, system.initial)), atol="; ".join(map(repr, system.tolerances(rtol))), rtol=repr(rtol),
            times=", ".join(map(repr, request["times"])), method=method, repeats=request["repeats"],
        )
        kept = {}

        def solve():
            # One Octave session makes all repetitions of the solve and returns their median time.
            if not kept:
                told = subprocess.run(["octave-cli", "--norc", "--eval", text], capture_output=True, text=True, timeout=1.5 * LONGEST)
                if not told.stdout.startswith("{"):
                    raise RuntimeError(told.stderr.strip()[:150].replace("\n", " ") or "no answer")
                kept.update(json.loads(told.stdout))
            columns = list(zip(*kept["y"]))
            return {"fields": dict(zip(system.names, columns)), "steps": kept["steps"], "seconds": kept["seconds"]}

        return solve

    return prepare


def systems(request):
    from smooth import NAMES

    return [(f"Octave {method}", "rtol", session(method)) for method in ("ode15s", "lsode")] if request["system"] in NAMES else []


if __name__ == "__main__":
    main(name, "Octave\ntests/peers/install, or: apt install octave; python3 -m pip install sympy", systems)
