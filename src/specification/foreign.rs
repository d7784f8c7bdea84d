//! Keys and choices that other programs know by other names, and keys that stand in another place.

/// What people write, and the keys or choices for it here; the first that is valid in its place is meant.
const SYNONYMS: [(&[&str], &[&str]); 24] = [
    (&["t_end", "tend", "tstop", "t_stop", "t_final", "t_max", "until", "stop_time", "final_time"], &["end"]),
    (&["t0", "t_start", "start_time", "begin"], &["start"]),
    (&["x0", "y0", "init", "initial_value", "initial_condition", "ic", "start"], &["initial"]),
    (&["rhs", "equation", "derivative", "der", "ode", "f", "dynamics", "dxdt"], &["rate"]),
    (&["constraint", "complementarity", "g", "condition"], &["inequality", "constraint"]),
    (&["dt", "h", "step_size", "stepsize", "time_step", "timestep"], &["step", "every"]),
    (&["reltol", "rel_tol", "tol", "tolerance"], &["rtol"]),
    (&["abstol", "abs_tol"], &["atol"]),
    (&["hmax", "h_max", "max_dt"], &["max_step"]),
    (&["params", "constants", "param"], &["parameters"]),
    (&["lookup", "lookups", "table", "interpolants"], &["tables"]),
    (&["unknowns", "odes", "equations"], &["states"]),
    (&["outputs", "signals", "columns"], &["fields"]),
    (&["events", "terminate", "termination"], &["stop"]),
    (&["lb", "lower_bound", "min", "low"], &["lower"]),
    (&["ub", "upper_bound", "max", "high"], &["upper"]),
    (&["diameter"], &["radius"]),
    (&["plane", "ground", "halfspace"], &["half_space"]),
    (&["mesh", "trimesh"], &["triangle_mesh"]),
    (&["revolute"], &["hinge"]),
    (&["prismatic", "translational"], &["slider"]),
    (&["spherical"], &["ball"]),
    (&["euler", "rotation", "quaternion", "rpy"], &["orientation"]),
    (
        &["value", "r", "c", "l", "resistance", "capacitance", "inductance"],
        &["ohms", "farads", "henries", "volts", "amperes"],
    ),
];

/// What connects a component, which each names in its own way.
const NODES: [&str; 6] = ["anode", "cathode", "plus", "minus", "terminals", "pins"];

/// The keys of the parts of a document, and those of most types of problem.
const PLACES: [(&str, &[&str]); 6] = [
    ("the document", &["problem", "time", "method", "output", "limits", "stop", "sensitivities", "study", "label"]),
    ("`time`", &["start", "end"]),
    (
        "`method`",
        &[
            "rtol",
            "atol",
            "step",
            "first_step",
            "max_step",
            "min_step",
            "switches",
            "vi_solver",
            "vi_tolerance",
            "impacts",
        ],
    ),
    ("`output`", &["times", "fields", "global_error"]),
    ("`limits`", &["wall_seconds", "steps"]),
    (
        "the problem, beside its type's other keys",
        &["parameters", "definitions", "integrals", "tables", "states", "variables", "set", "mass"],
    ),
];

/// The key or choice that another program's name stands for, among the valid ones.
pub(super) fn synonym(name: &str, valid: &[&'static str]) -> Option<&'static str> {
    let folded = name.to_ascii_lowercase();
    if NODES.contains(&folded.as_str()) {
        return valid.iter().copied().find(|key| *key == "nodes");
    }
    let meant = SYNONYMS.iter().filter(|(foreign, _)| foreign.contains(&folded.as_str())).flat_map(|(_, ours)| *ours);
    meant.into_iter().find_map(|ours| valid.iter().copied().find(|key| key == ours))
}

/// Where a key belongs that does not stand where it is valid, and how it is called there.
pub(super) fn place_of(name: &str) -> Option<(&'static str, &'static str)> {
    let direct =
        PLACES.iter().find_map(|(place, keys)| keys.iter().find(|key| **key == name).map(|key| (*place, *key)));
    direct.or_else(|| PLACES.iter().find_map(|(place, keys)| synonym(name, keys).map(|key| (*place, key))))
}
