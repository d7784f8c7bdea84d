function answer = dvi_solve (specification, url, token)
  % answer = dvi_solve (specification)
  % answer = dvi_solve (specification, url, token)
  %
  % Has a service solve a specification, a struct or JSON text, and gives the answer as a struct. For MATLAB and Octave;
  % needs curl, since the webwrite of Octave sends an empty body. The service is at http://localhost:8080 unless told.
  %
  %   s.problem.dvi.parameters = struct ("k", 1, "f", 1);
  %   s.problem.dvi.states.x = struct ("initial", 4, "rate", "v");
  %   s.problem.dvi.states.v = struct ("initial", 0, "rate", "-k*x - F");
  %   s.problem.dvi.variables.F.inequality = "-v";
  %   s.problem.dvi.set.box = struct ("of", "F", "lower", "-f", "upper", "f");
  %   s.time.until = 20;              % `end` is a reserved word: `until` is the same
  %   r = dvi_solve (s);
  %   plot (r.trajectory.t, r.trajectory.fields.x)
  %
  % One-element lists may be written without brackets, as `set` and `of` above. Names of columns that are no names of MATLAB
  % come as jsondecode makes them: `v(out)` is r.trajectory.fields.v_out_.
  %
  % Errors of the specification are an error whose message has each with its place.
  if (nargin < 2 || isempty (url)), url = 'http://localhost:8080'; end
  if (nargin < 3), token = ''; end
  text = specification;
  if (~ischar (text)), text = jsonencode (text); end
  sent = tempname (); got = tempname ();
  tidy = onCleanup (@() cellfun (@forget, {sent, got}));
  write_text (sent, text);
  command = sprintf ('curl -sS -o "%s" -w "%%{http_code}" -H "Content-Type: application/json"', got);
  command = [command ' -H "Prefer: wait=60" -H "Accept: application/json"'];
  if (~isempty (token))
    % curl reads the token from a file, since all users of a machine can see a command line.
    secret = tempname (); tidy_secret = onCleanup (@() forget (secret));
    write_text (secret, sprintf ('header = "Authorization: Bearer %s"', token));
    command = sprintf ('%s -K "%s"', command, secret);
  end
  [failed, status] = system (sprintf ('%s --data-binary "@%s" "%s/solve"', command, sent, url));
  if (failed), error ('dvi:unreachable', '%s does not answer: %s', url, status); end
  status = str2double (status);
  body = fileread (got);
  while (status == 202)
    % The solve takes longer than the wait: the job is polled until it has ended.
    job = jsondecode (body);
    pause (0.5);
    get = @(path) system (sprintf ('%s "%s/jobs/%s%s"', command, url, job.id, path));
    [~, status] = get (''); status = str2double (status); body = fileread (got);
    state = jsondecode (body);
    if (status ~= 200), break; end
    if (any (strcmp (state.status, {'accepted', 'running'}))), status = 202; continue; end
    [~, status] = get ('/results'); status = str2double (status); body = fileread (got);
  end
  answer = jsondecode (body);
  if (status ~= 200), error ('dvi:refused', '%s', told (answer)); end
  if (~answer.verdict.trusted), warning ('dvi:untrusted', 'the answer is not trusted: see verdict.because'); end
end

function text = told (problem)
  text = sprintf ('%s: %s', problem.title, problem.detail);
  if (~isfield (problem, 'errors')), return; end
  errors = problem.errors;
  for k = 1:numel (errors)
    if (iscell (errors)), one = errors{k}; else, one = errors(k); end
    text = sprintf ('%s\n  %s: %s', text, one.pointer, one.detail);
    if (isfield (one, 'did_you_mean') && ~isempty (one.did_you_mean))
      text = sprintf ('%s; did you mean %s?', text, one.did_you_mean);
    end
  end
end

function write_text (name, text)
  file = fopen (name, 'w'); fwrite (file, unicode2native (text, 'UTF-8')); fclose (file);
end

function forget (name)
  if (exist (name, 'file')), delete (name); end
end
