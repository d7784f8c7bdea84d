% The service reads specifications as Octave writes them in JSON, and results are structs.
% Usage: octave solve.m, with the environment variables DVI_SERVER and DVI_TOKEN.
1;
addpath (fullfile (fileparts (mfilename ('fullpath')), '..', '..', 'api', 'octave'));
url = getenv ('DVI_SERVER');
token = getenv ('DVI_TOKEN');

% A mass on a belt as a struct: `until` stands for `end`, and lists of one element are written without brackets.
s.problem.dvi.parameters = struct ('k', 1, 'f', 1, 'v_belt', 0.5);
s.problem.dvi.states.x = struct ('initial', 4, 'rate', 'v');
s.problem.dvi.states.v = struct ('initial', 0, 'rate', '-k*x - F');
s.problem.dvi.variables.F.inequality = '-(v - v_belt)';
s.problem.dvi.set.box = struct ('of', 'F', 'lower', '-f', 'upper', 'f');
s.time.until = 1;
s.method.rtol = 1e-10;
r = dvi_solve (s, url, token);
% The mass slides backwards over the belt, and oscillates about x = 1 from x = 4.
t = r.trajectory.t(end);
assert (r.trajectory.fields.x(end), 1 + 3 * cos (t), 1e-8);
assert (r.verdict.trusted);
disp ('ok  a struct is solved, as its closed form says');

% A linear complementarity system with one state: matrices of one entry are scalars, and the zero matrix D is left out.
l.problem.lcs = struct ('initial', 1, 'A', -1, 'a', -1, 'B', 1, 'C', 1, 'g', 0);
l.problem.lcs.set.nonnegative = 'z1';
l.time.until = 2;
r = dvi_solve (l, url, token);
assert (isfield (r.trajectory.fields, 'x1') && abs (r.trajectory.fields.x1(end)) < 1e-6);
disp ('ok  matrices of one entry are scalars');

% Two states and one variable: Octave writes column and row vectors both as flat lists.
l.problem.lcs = struct ('initial', [1 2], 'A', [-1 0; 0 -2], 'B', [1; 3], 'C', [1 4], 'D', 1);
l.problem.lcs.set.nonnegative = 'z1';
r = dvi_solve (l, url, token);
assert (r.trajectory.fields.x2(end), 2 * exp (-4), 1e-5);
disp ('ok  columns and rows are flat lists');

% Components are a cell array of structs, and the nodes of a component a cell array of names.
c.problem.circuit.components = {struct('resistor', struct ('name', 'R1', 'nodes', {{'a', '0'}}, 'ohms', 2)), ...
    struct('inductor', struct ('name', 'L1', 'nodes', {{'a', '0'}}, 'henries', 1, 'amperes', 3))};
c.time.until = 1;
r = dvi_solve (c, url, token);
names = fieldnames (r.trajectory.fields);
assert (numel (names) > 2);
disp ('ok  a circuit is solved');

% The error for a faulty specification lists the place of each fault.
b = s; b.problem.dvi.states.x = struct ('inital', 4, 'rate', 'w');
try
  dvi_solve (b, url, token);
  error ('it was solved');
catch told
  assert (strcmp (told.identifier, 'dvi:refused'), told.message);
  assert (! isempty (strfind (told.message, '/problem/dvi/states/x/inital')), told.message);
  assert (! isempty (strfind (told.message, 'did you mean initial?')), told.message);
end
disp ('ok  errors have their places');

% NaN in the data of a fit, which Octave writes as null, stands for a missing measurement.
d.problem.dvi.parameters.k = 1;
d.problem.dvi.states.x = struct ('initial', 1, 'rate', '-k*x');
d.fit.parameters.k = struct ('lower', 0);
d.fit.data = struct ('t', [0.5 1 1.5 2], 'x', exp (-0.7 * [0.5 1 1.5 2]), 'sd', 0.01);
d.fit.data.x(2) = NaN;
d.time.until = 2;
r = dvi_solve (d, url, token);
assert (r.fit.parameters.k.estimate, 0.7, 1e-5);
disp ('ok  NaN is a gap in data');

% `until` stands for `end`, which is a reserved word in MATLAB, and must not occur beside it.
b = s; b.time = struct ('until', 1, 'end', 1);
try
  dvi_solve (b, url, token);
  error ('it was solved');
catch told
  assert (! isempty (strfind (told.message, '/time/until')), told.message);
end
disp ('ok  an end has one name');

% A specification may be JSON text; a service that requires tokens refuses a request without one.
text = fileread (fullfile (fileparts (mfilename ('fullpath')), '..', '..', 'api', 'examples', 'friction_belt.json'));
assert (dvi_solve (text, url, token).trajectory.t(end), 20);
try
  dvi_solve (text, url);
  error ('it was solved');
catch told
  assert (strcmp (told.identifier, 'dvi:refused') && isempty (strfind (told.message, 'it was solved')), told.message);
end
disp ('ok  tokens are shown and asked for');

try
  dvi_solve (s, 'http://127.0.0.1:9');
  error ('it was solved');
catch told
  assert (strcmp (told.identifier, 'dvi:unreachable'), told.message);
end
disp ('ok  nobody there is said so');
