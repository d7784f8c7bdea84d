//! Tests of the independent reference methods against closed forms: a diode bridge, a bouncing ball, a sliding relay,
//! a projection.

use crate::differential::linear::{Linear, Shape};
use crate::differential::reference::{Membrane, Stop, by_modes, by_projection};
use crate::differential::signal::{Signal, Wave};
use std::f64::consts::{PI, TAU};

fn largest_distance(values: &[f64], times: &[f64], exact: impl Fn(f64) -> f64) -> f64 {
    times.iter().zip(values).map(|(&t, x)| (x - exact(t)).abs()).fold(0.0, f64::max)
}

fn times(end: f64) -> Vec<f64> {
    (1..=40).map(|k| end * f64::from(k) / 40.0).collect()
}

/// A diode bridge, `v' = -i/C - |v|/(R C)`, `i' = v/L`: each half wave of the voltage is half a period of a damped
/// oscillation.
#[test]
fn four_diodes_damp_an_oscillation() {
    let (resistance, capacity, inductance) = (1e3, 1e-6, 1e-2);
    let bridge = Linear {
        initial: vec![10.0, 0.0],
        a: vec![vec![0.0, -1.0 / capacity], vec![1.0 / inductance, 0.0]],
        b: vec![vec![0.0, 0.0, -1.0 / capacity, 1.0 / capacity], vec![0.0; 4]],
        c: vec![vec![0.0, 0.0], vec![0.0, 0.0], vec![-1.0, 0.0], vec![1.0, 0.0]],
        d: vec![
            vec![1.0 / resistance, 1.0 / resistance, -1.0, 0.0],
            vec![1.0 / resistance, 1.0 / resistance, 0.0, -1.0],
            vec![1.0, 0.0, 0.0, 0.0],
            vec![0.0, 1.0, 0.0, 0.0],
        ],
        drive: vec![Signal::default(); 2],
        gap: vec![Signal::default(); 4],
        set: vec![(Shape::Nonnegative, 4)],
    };
    let times = times(2e-3);
    let values = by_modes(&bridge, &bridge.initial, &times).expect("an answer");
    // The bridge reverses the current with the voltage, so that it acts on the oscillator as a resistor.
    let alpha = 1.0 / (2.0 * resistance * capacity);
    let omega = (1.0 / (inductance * capacity) - alpha * alpha).sqrt();
    let v = |t: f64| 10.0 * (-alpha * t).exp() * ((omega * t).cos() - alpha / omega * (omega * t).sin());
    let far = largest_distance(&values.columns[0], &times, v);
    assert!(far < 1e-8, "{far:e}");
}

/// Tests a peak detector, which holds the largest voltage so far, reduced by its discharge.
#[test]
fn a_detector_holds_the_peaks() {
    let tau = 10.0;
    let source = Signal { constant: 0.0, waves: vec![Wave { amplitude: 10.0, omega: 100.0 * PI, phase: 0.0 }] };
    let mut below = Signal::default();
    below.add(-1.0, &source);
    let detector = Linear {
        initial: vec![0.5],
        a: vec![vec![-1.0 / tau]],
        b: vec![vec![1.0]],
        c: vec![vec![1.0]],
        d: vec![vec![0.0]],
        drive: vec![Signal::default()],
        gap: vec![below],
        set: vec![(Shape::Nonnegative, 1)],
    };
    // While the diode blocks, the voltage decays from the time at which the source begins to fall faster: tan(w t) =
    // -w tau.
    let omega = 100.0 * PI;
    let off = (PI - (omega * tau).atan()) / omega;
    let level = 10.0 * (omega * off).sin();
    for k in 1..25 {
        let t = off + (f64::from(k) - 0.5) * TAU / omega;
        let values = by_modes(&detector, &[0.5], &[t]).expect("an answer");
        let since = (t - off) % (TAU / omega);
        let exact = level * (-since / tau).exp();
        assert!((values.columns[0][0] - exact).abs() < 1e-9, "{} instead of {exact}", values.columns[0][0]);
    }
}

/// The relay `x' = 0.3 - sgn x` from 2 reaches zero at 2/0.7, and slides there.
#[test]
fn a_relay_slides() {
    let relay = Linear {
        initial: vec![2.0],
        a: vec![vec![0.0]],
        b: vec![vec![1.0]],
        c: vec![vec![1.0]],
        d: vec![vec![0.0]],
        drive: vec![Signal::constant(0.3)],
        gap: vec![Signal::default()],
        set: vec![(Shape::Box(-1.0, 1.0), 1)],
    };
    let times = times(5.0);
    let values = by_modes(&relay, &relay.initial, &times).expect("an answer");
    let far = largest_distance(&values.columns[0], &times, |t| (2.0 - 0.7 * t).max(0.0));
    assert!(far < 1e-10, "{far:e}");
    let stepped = by_projection(&relay, &relay.initial, &times, 1000).expect("an answer");
    let far = largest_distance(&stepped.columns[0], &times, |t| (2.0 - 0.7 * t).max(0.0));
    assert!(far < stepped.accuracy[0] && stepped.accuracy[0] < 1e-2, "{far:e} {:e}", stepped.accuracy[0]);
}

/// The relay `x'' = -sgn x` from rest at 1 moves along parabolas, with the period `4 sqrt 2`.
#[test]
fn a_relay_after_two_integrations_oscillates() {
    let relay = Linear {
        initial: vec![1.0, 0.0],
        a: vec![vec![0.0, 1.0], vec![0.0, 0.0]],
        b: vec![vec![0.0], vec![1.0]],
        c: vec![vec![1.0, 0.0]],
        d: vec![vec![0.0]],
        drive: vec![Signal::default(); 2],
        gap: vec![Signal::default()],
        set: vec![(Shape::Box(-1.0, 1.0), 1)],
    };
    let times = times(30.0);
    let values = by_modes(&relay, &relay.initial, &times).expect("an answer");
    let quarter = 2.0_f64.sqrt();
    let exact = |t: f64| {
        let phase = t.rem_euclid(4.0 * quarter);
        let s = if phase > 2.0 * quarter { 4.0 * quarter - phase } else { phase };
        if s < quarter { 1.0 - s * s / 2.0 } else { -1.0 + (2.0 * quarter - s).powi(2) / 2.0 }
    };
    let far = largest_distance(&values.columns[0], &times, exact);
    assert!(far < 1e-8, "{far:e}");
}

/// A ball dropped from the height `h` loses `1 - e^2` of its height at each bounce, and comes to rest.
#[test]
fn a_ball_bounces() {
    let (g, e) = (9.81, 0.5);
    let ball = Stop {
        stiffness: 0.0,
        damping: 0.0,
        force: Signal::constant(-g),
        wall: 0.0,
        restitution: e,
        initial: [1.0, 0.0],
    };
    let times = times(2.0);
    let values = ball.solve(&times).expect("an answer");
    let exact = |t: f64| {
        let first = (2.0 / g).sqrt();
        if t < first {
            return 1.0 - g * t * t / 2.0;
        }
        let (mut start, mut speed) = (first, e * g * first);
        while speed > 1e-12 {
            let end = start + 2.0 * speed / g;
            if t < end {
                return speed * (t - start) - g * (t - start).powi(2) / 2.0;
            }
            (start, speed) = (end, e * speed);
        }
        0.0
    };
    let far = largest_distance(&values.columns[0], &times, exact);
    assert!(far < 1e-9, "{far:e}");
}

/// The system `x' = -x + z_0`, where `z` is the projection of a rotating vector onto a cone: the apex for part of the
/// time.
#[test]
fn a_cone_is_projected_on() {
    let wave = |phase: f64| Signal { constant: 0.0, waves: vec![Wave { amplitude: -1.0, omega: 1.0, phase }] };
    let cone = Linear {
        initial: vec![0.0],
        a: vec![vec![-1.0]],
        b: vec![vec![1.0, 0.0]],
        c: vec![vec![0.0], vec![0.0]],
        d: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
        drive: vec![Signal::default()],
        gap: vec![wave(PI / 2.0), wave(0.0)],
        set: vec![(Shape::Cone, 2)],
    };
    // In the axes of the rotated quadrant, the projection of (cos t, sin t) takes the positive parts of its components:
    // the first component of z is (p + q)/sqrt 2 with p, q = max(0, (cos t +- sin t)/sqrt 2).
    let times = times(6.0);
    let values = by_projection(&cone, &cone.initial, &times, 4000).expect("an answer");
    let z = |t: f64| ((t.cos() + t.sin()).max(0.0) + (t.cos() - t.sin()).max(0.0)) / 2.0;
    let exact = |t: f64| {
        let (steps, mut x) = (20_000, 0.0);
        let h = t / f64::from(steps);
        for k in 0..steps {
            // Evaluates x = int exp(s - t) z(s) by the midpoint rule.
            let s = (f64::from(k) + 0.5) * h;
            x += h * (s - t).exp() * z(s);
        }
        x
    };
    let far = largest_distance(&values.columns[0], &times, exact);
    assert!(far < 1e-6, "{far:e}");
}

/// A membrane with free ends stays flat: `u' = cos t` between the obstacles, so that `u` rises to 0.5, stays there
/// until the source changes sign at `pi/2`, falls to -0.5 and stays again.
#[test]
fn a_membrane_rises_and_falls_between_two_obstacles() {
    let membrane = Membrane {
        elements: 8,
        diffusion: 1.0,
        reaction: 0.0,
        source: Signal { constant: 0.0, waves: vec![Wave { amplitude: 1.0, omega: 1.0, phase: PI / 2.0 }] },
        bulge: 0.0,
        bounds: (-0.5, 0.5),
        initial: 0.0,
        held: [false, false],
    };
    let times = times(TAU);
    let values = membrane.solve(&[0.5, 0.25, 0.875], &times).expect("an answer");
    let exact = |t: f64| {
        if t < PI / 2.0 {
            t.sin().min(0.5)
        } else if t < 1.5 * PI {
            (0.5 - (1.0 - t.sin())).max(-0.5)
        } else {
            (-0.5 + t.sin() + 1.0).min(0.5)
        }
    };
    for column in &values.columns {
        let far = largest_distance(column, &times, exact);
        assert!(far < 1e-5, "{far:e}");
    }
}
