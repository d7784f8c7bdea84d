//! Example specifications, one for each system of the theory, included from `api/examples`.

macro_rules! examples {
    ($($name:literal)*) => {
        &[$(Example {
            name: $name,
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/examples/", $name, ".json")),
        }),*]
    };
}

/// An example specification from `api/examples`.
#[derive(Debug)]
pub struct Example {
    /// Name of the file without the extension.
    pub name: &'static str,
    /// Content of the file, a specification as JSON text.
    pub text: &'static str,
}

/// All examples: every file of `api/examples`.
pub const EXAMPLES: &[Example] = examples! {
    "american_put"
    "bar_impact"
    "belt_fit"
    "bottleneck"
    "bounce_slope"
    "bouncing_ball"
    "bouncing_ball_slopes"
    "braess"
    "buck_closed_loop"
    "buck_converter"
    "buck_orbit"
    "charger"
    "chattering_modes"
    "coulomb_slope"
    "crank_slider"
    "diode_bridge"
    "diode_bridge_dvi"
    "diode_bridge_filter"
    "diode_bridge_netlist"
    "elliptic_friction"
    "fluid_queue"
    "friction_belt"
    "friction_belt_map"
    "friction_chain"
    "friction_disk"
    "heavy_chain"
    "held_capsule"
    "hires"
    "lost_bounce"
    "memory_abel"
    "memory_relaxation"
    "nash_cournot"
    "newton_cradle"
    "obstacle_membrane"
    "oxygen_diffusion"
    "pendulum"
    "pollu"
    "rectifier"
    "relay"
    "reverse_zeno"
    "robertson"
    "rocking_block"
    "rolling_ball"
    "rougher_floor"
    "shaken_ball_branch"
    "shaken_table"
    "sliding_cube"
    "sliding_mode"
    "spinning_disc"
    "string_obstacle"
    "switching_circle"
    "three_regions"
    "three_roots"
    "torn_off"
    "van_der_pol"
    "viscoelastic_block"
    "woodpecker"
};
