//! The units of outputs, where a type of problem has SI units: circuits and bodies in space. Elsewhere they are the user's.

/// Endings of the outputs of bodies and joints, with their units.
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

/// The outputs of a scene as a whole, with their units.
const OF_SCENES: [(&str, &str); 7] = [
    ("kinetic_energy", "J"),
    ("potential_energy", "J"),
    ("dissipated_by_friction", "J"),
    ("lost_in_impacts", "J"),
    ("contacts", "1"),
    ("penetration", "m"),
    ("normal_impulse", "N s"),
];

/// Beginnings of the outputs of circuits, with their units.
const OF_CIRCUITS: [(&str, &str); 6] =
    [("v(", "V"), ("v_blocked(", "V"), ("i(", "A"), ("flux(", "V s"), ("charge(", "C"), ("closed(", "1")];

/// The unit of time of a type of problem.
pub(super) fn of_time(problem: &str) -> Option<&'static str> {
    matches!(problem, "circuit" | "rigid_bodies").then_some("s")
}

/// The unit of an output of a type of problem.
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
