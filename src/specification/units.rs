//! The units of outputs, for the types of problems that have SI units: circuits and rigid bodies. The units of other
//! problems are the user's.

/// Endings of the names of outputs of bodies and joints, with the units of the outputs.
const OF_BODIES: [(&str, &str); 26] = [
    (".x", "m"),
    (".y", "m"),
    (".z", "m"),
    (".vx", "m/s"),
    (".vy", "m/s"),
    (".vz", "m/s"),
    (".wx", "rad/s"),
    (".wy", "rad/s"),
    (".wz", "rad/s"),
    (".fx", "N"),
    (".fy", "N"),
    (".fz", "N"),
    (".contact_fx", "N"),
    (".contact_fy", "N"),
    (".contact_fz", "N"),
    (".force", "N"),
    (".tx", "N m"),
    (".ty", "N m"),
    (".tz", "N m"),
    (".contact_tx", "N m"),
    (".contact_ty", "N m"),
    (".contact_tz", "N m"),
    (".qw", "1"),
    (".qx", "1"),
    (".qy", "1"),
    (".qz", "1"),
];

/// Names of the outputs of a scene as a whole, with the units of the outputs.
const OF_SCENES: [(&str, &str); 7] = [
    ("kinetic_energy", "J"),
    ("potential_energy", "J"),
    ("dissipated_by_friction", "J"),
    ("lost_in_impacts", "J"),
    ("contacts", "1"),
    ("penetration", "m"),
    ("normal_impulse", "N s"),
];

/// Beginnings of the names of outputs of circuits, with the units of the outputs.
const OF_CIRCUITS: [(&str, &str); 6] =
    [("v(", "V"), ("v_blocked(", "V"), ("i(", "A"), ("flux(", "V s"), ("charge(", "C"), ("closed(", "1")];

/// Returns the unit of time of a type of problem, if it has SI units.
pub(super) fn of_time(problem: &str) -> Option<&'static str> {
    matches!(problem, "circuit" | "rigid_bodies").then_some("s")
}

/// Returns the SI unit of an output of a type of problem, if it is known.
pub(super) fn of_output(problem: &str, output: &str) -> Option<&'static str> {
    let find = |of: &[(&str, &'static str)], is: fn(&str, &str) -> bool| {
        of.iter().find(|(part, _)| is(output, part)).map(|(_, unit)| *unit)
    };
    match problem {
        "circuit" => find(&OF_CIRCUITS, |output, beginning| output.starts_with(beginning)),
        "rigid_bodies" => {
            let of_scene = find(&OF_SCENES, |output, name| output == name);
            of_scene.or_else(|| find(&OF_BODIES, |output, ending| output.ends_with(ending)))
        }
        _ => None,
    }
}
