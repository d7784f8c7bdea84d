use crate::orders::*;
use dvi::problem::*;
use dvi::radau::*;

fn go(problem: &mut dyn Dvi, s: usize, x: &[f64], end: f64, steps: usize, exact: &[f64]) {
    let mut st = settings(s, end / steps as f64, x.len());
    st.rtol = 1e-13;
    let mut radau = Radau::new(problem, st, 0.0, x, end).unwrap();
    let mut sw = vec![];
    while !radau.is_done() {
        if let Err(e) = radau.step() {
            println!("{e} at {}", radau.t());
            break;
        }
        for s in radau.take_switches() {
            sw.push((s.t, s.variable, s.to));
        }
    }
    let err = radau.y().iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!(
        "s={s} steps={steps} err={err:.3e} acc={} work={:?} {:?}",
        radau.counts.accepted,
        radau.work(),
        &sw[..sw.len().min(6)]
    );
}

#[test]
fn belt() {
    for s in 1..=3 {
        for steps in [20, 40, 80, 160, 320] {
            let mut set = ConvexSet::free(1);
            set.lower[0] = -1.0;
            set.upper[0] = 1.0;
            let mut p = Problem {
                structure: structure(2, set),
                values: |_: f64, y: &[f64], v: &mut [f64]| {
                    v[0] = y[1];
                    v[1] = -0.1 * y[1] - y[0] - y[2];
                    v[2] = -(y[1] - 0.5);
                },
                derivatives: |_: f64, _: &[f64], d: &mut [f64]| {
                    d.copy_from_slice(&[0., 1., 0., -1., -0.1, -1., 0., -1., 0.])
                },
            };
            go(&mut p, s, &[4.0, 0.0], 20.0, steps, &[0.84196023857723147943, 0.23125560020444858641]);
        }
    }
}
#[test]
fn sliding() {
    for s in 1..=3 {
        for steps in [10, 20, 40, 80, 160] {
            let mut set = ConvexSet::free(1);
            set.lower[0] = -2.0;
            set.upper[0] = 2.0;
            let mut p = Problem {
                structure: structure(2, set),
                values: |_: f64, y: &[f64], v: &mut [f64]| {
                    v[0] = y[1];
                    v[1] = 0.5 * y[0] - y[2];
                    v[2] = -(y[1] + y[0]);
                },
                derivatives: |_: f64, _: &[f64], d: &mut [f64]| {
                    d.copy_from_slice(&[0., 1., 0., 0.5, 0., -1., -1., -1., 0.])
                },
            };
            go(&mut p, s, &[1.0, 0.0], 5.0, steps, &[0.0090090028748071408967, -0.0090090028748071408967]);
        }
    }
}
#[test]
fn circle() {
    use std::f64::consts::PI;
    for s in 1..=3 {
        for steps in [20, 40, 80, 160, 320] {
            let mut set = ConvexSet::free(1);
            set.lower[0] = 0.0;
            set.upper[0] = 1.0;
            // z = 1: inside (A2), z=0 outside. G = |x|^2 - 1 (outside: G>0 -> z = 0 ok)
            let mut p = Problem {
                structure: structure(2, set),
                values: |_: f64, y: &[f64], v: &mut [f64]| {
                    let w = 2.0 * PI * (1.0 - 2.0 * y[2]);
                    v[0] = y[0] + w * y[1];
                    v[1] = y[1] - w * y[0];
                    v[2] = y[0] * y[0] + y[1] * y[1] - 1.0;
                },
                derivatives: |_: f64, y: &[f64], d: &mut [f64]| {
                    let w = 2.0 * PI * (1.0 - 2.0 * y[2]);
                    d.copy_from_slice(&[1., w, -4.0 * PI * y[1], -w, 1., 4.0 * PI * y[0], 2.0 * y[0], 2.0 * y[1], 0.])
                },
            };
            let t = PI / 2.0;
            let e = (t - 1.0).exp();
            go(
                &mut p,
                s,
                &[(-1.0f64).exp(), 0.0],
                t,
                steps,
                &[e * (2.0 * PI * (t - 1.0)).cos(), -e * (2.0 * PI * (t - 1.0)).sin()],
            );
        }
    }
}
#[test]
fn adaptive() {
    for auto in [false, true] {
        for rtol in [1e-3, 1e-5, 1e-7, 1e-9, 1e-11] {
            let mut set = ConvexSet::free(1);
            set.lower[0] = -1.0;
            set.upper[0] = 1.0;
            let mut p = Problem {
                structure: structure(2, set),
                values: |_: f64, y: &[f64], v: &mut [f64]| {
                    v[0] = y[1];
                    v[1] = -0.1 * y[1] - y[0] - y[2];
                    v[2] = -(y[1] - 0.5);
                },
                derivatives: |_: f64, _: &[f64], d: &mut [f64]| {
                    d.copy_from_slice(&[0., 1., 0., -1., -0.1, -1., 0., -1., 0.])
                },
            };
            p.structure.constant_jacobian = true;
            let mut st = settings(3, 1.0, 2);
            st.step = None;
            st.rtol = rtol;
            st.atol = vec![rtol; 2];
            if auto {
                st.stages = StageChoice::Auto;
            }
            let mut radau = Radau::new(&mut p, st.clone(), 0.0, &[4.0, 0.0], 20.0).unwrap();
            let t0 = std::time::Instant::now();
            while !radau.is_done() {
                radau.step().unwrap();
            }
            let el = t0.elapsed();
            let err = radau
                .y()
                .iter()
                .zip(&[0.84196023857723147943, 0.23125560020444858641])
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            println!("rtol {rtol} err {err:.2e} {:?} {:?} {:?}", radau.counts, radau.work(), el);
        }
    }
    for mu in [1e-3, 1e-6] {
        for auto in [false, true] {
            for rtol in [1e-3, 1e-5, 1e-7, 1e-9] {
                let mut p = Problem {
                    structure: structure(2, ConvexSet::free(0)),
                    values: |_: f64, y: &[f64], v: &mut [f64]| {
                        v[0] = y[1];
                        v[1] = ((1.0 - y[0] * y[0]) * y[1] - y[0]) / mu;
                    },
                    derivatives: |_: f64, y: &[f64], d: &mut [f64]| {
                        d.copy_from_slice(&[0., 1., (-2.0 * y[0] * y[1] - 1.0) / mu, (1.0 - y[0] * y[0]) / mu])
                    },
                };
                let mut st = settings(3, 1.0, 2);
                st.step = None;
                st.rtol = rtol;
                st.atol = vec![rtol; 2];
                if auto {
                    st.stages = StageChoice::Auto;
                }
                let t0 = std::time::Instant::now();
                let mut radau = Radau::new(&mut p, st.clone(), 0.0, &[2.0, 0.0], 2.0).unwrap();
                while !radau.is_done() {
                    radau.step().unwrap();
                }
                let el = t0.elapsed();
                let exact = if mu == 1e-3 {
                    [1.763234540203445703845154266, -8.356886816776773916151272655e-1]
                } else {
                    [1.706167732170465008478187659, -8.92809701024816547910307997e-1]
                };
                let err = radau.y().iter().zip(&exact).map(|(a, b)| ((a - b) / b).abs()).fold(0.0, f64::max);
                println!("vdp {mu} rtol {rtol} err {err:.2e} {:?} {:?} {:?}", radau.counts, radau.work(), el);
            }
        }
    }
}
