% What Octave writes as JSON is understood, and what comes back is a struct. Usage: octave solve.m, with DVI_SERVER and DVI_TOKEN.
1;
addpath (fullfile (fileparts (mfilename ('fullpath')), '..', '..', 'api', 'octave'));
url = getenv ('DVI_SERVER');
token = getenv ('DVI_TOKEN');

% A block on a belt, in structs: `until` for `end`, one block of the set and one variable without brackets.
s.problem.dvi.parameters = struct ('k', 1, 'f', 1, 'v_belt', 0.5);
s.problem.dvi.states.x = struct ('initial', 4, 'rate', 'v');
s.problem.dvi.states.v = struct ('initial', 0, 'rate', '-k*x - F');
s.problem.dvi.variables.F.inequality = '-(v - v_belt)';
s.problem.dvi.set.box = struct ('of', 'F', 'lower', '-f', 'upper', 'f');
s.time.until = 1;
s.method.rtol = 1e-10;
r = dvi_solve (s, url, token);
% It slides backwards over the belt from x = 4 about x = 1.
t = r.trajectory.t(end);
assert (r.trajectory.fields.x(end), 1 + 3 * cos (t), 1e-8);
assert (r.verdict.trusted);
disp ('ok  a struct is solved, as its closed form says');

% A linear complementarity problem of one state: matrices of one entry are scalars, and absent values are not written.
l.problem.lcs = struct ('initial', 1, 'A', -1, 'a', -1, 'B', 1, 'C', 1, 'g', 0);
l.problem.lcs.set.nonnegative = 'z1';
l.time.until = 2;
r = dvi_solve (l, url, token);
assert (isfield (r.trajectory.fields, 'x1') && abs (r.trajectory.fields.x1(end)) < 1e-6);
disp ('ok  matrices of one entry are scalars');

% Two states and one variable: a column and a row are both flat lists.
l.problem.lcs = struct ('initial', [1 2], 'A', [-1 0; 0 -2], 'B', [1; 3], 'C', [1 4], 'D', 1);
l.problem.lcs.set.nonnegative = 'z1';
r = dvi_solve (l, url, token);
assert (r.trajectory.fields.x2(end), 2 * exp (-4), 1e-5);
disp ('ok  columns and rows are flat lists');

% One component is an object, two are a list; nodes are a list.
c.problem.circuit.components = {struct('resistor', struct ('name', 'R1', 'nodes', {{'a', '0'}}, 'ohms', 2)), ...
    struct('inductor', struct ('name', 'L1', 'nodes', {{'a', '0'}}, 'henries', 1, 'amperes', 3))};
c.time.until = 1;
r = dvi_solve (c, url, token);
names = fieldnames (r.trajectory.fields);
assert (numel (names) > 2);
disp ('ok  a circuit is solved');

% A bad specification is an error with every place.
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

% NaN, which JSON writes as null, is a value that was not measured.
d.problem.dvi.parameters.k = 1;
d.problem.dvi.states.x = struct ('initial', 1, 'rate', '-k*x');
d.fit.parameters.k = struct ('lower', 0);
d.fit.data = struct ('t', [0.5 1 1.5 2], 'x', exp (-0.7 * [0.5 1 1.5 2]), 'sd', 0.01);
d.fit.data.x(2) = NaN;
d.time.until = 2;
r = dvi_solve (d, url, token);
assert (r.fit.parameters.k.estimate, 0.7, 1e-5);
disp ('ok  NaN is a gap in data');

% A name for the end that can be written in MATLAB stands for `end`, and not beside it.
b = s; b.time = struct ('until', 1, 'end', 1);
try
  dvi_solve (b, url, token);
  error ('it was solved');
catch told
  assert (! isempty (strfind (told.message, '/time/until')), told.message);
end
disp ('ok  an end has one name');

% JSON text goes as it is; a service that asks for a token gets nothing done without.
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
