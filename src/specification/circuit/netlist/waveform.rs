//! Sources of a netlist as expressions in `t`. Ramps are written with `min` and `max`, jumps with `heaviside`, so that
//! integration steps end at their kinks and jumps.
//!
//! ```text
//! DC value                        the default
//! SIN(vo va freq td theta phase)  vo + va sin(2 pi freq s + phase) exp(-theta s), s = max(t - td, 0)
//! PULSE(v1 v2 td tr tf pw per)    v1, from td on v2 after a rise of tr, for pw, and v1 after a fall of tf; every per
//! PWL(t1 v1 t2 v2 ..)             straight lines between these points; where times are equal, jumps
//! EXP(v1 v2 td1 tau1 td2 tau2)    from td1 on towards v2 with the time constant tau1, from td2 on back with tau2
//! ```

use super::tokens::Token;
use super::{NetlistError, Rest};
use crate::expression::Expression;
use std::f64::consts::PI;

const KINDS: &str = "a value, DC, SIN, PULSE, PWL or EXP";

/// Largest number of points of a piecewise linear source.
const MOST_POINTS: usize = 500;

/// Reads the value or the waveform of a source, to the end of its line. A waveform overrides a constant value before
/// it.
pub(super) fn read(rest: &mut Rest<'_, '_>) -> Result<Expression, NetlistError> {
    let mut token = rest.next(KINDS)?;
    let mut source = None;
    if token.text.eq_ignore_ascii_case("dc") {
        source = Some(rest.value("a value")?.into());
    } else if rest.is_value(token) {
        source = Some(rest.number(token)?.into());
    }
    // Ignore the amplitude and phase that a source has for the AC analysis.
    if source.is_some() && rest.peek().is_some_and(|token| token.text.eq_ignore_ascii_case("ac")) {
        rest.next("AC")?;
        rest.values()?;
    }
    if let Some(constant) = source {
        match rest.peek() {
            None => return Ok(constant),
            Some(_) => token = rest.next(KINDS)?,
        }
    }
    let read = match token.text.to_ascii_lowercase().as_str() {
        "sin" | "sine" => sine,
        "pulse" => pulse,
        "pwl" => piecewise_linear,
        "exp" => exponential,
        _ => {
            let detail = format!("`{}` is not a known source", token.shown());
            return Err(NetlistError::new(token, "unknown_source", detail, KINDS));
        }
    };
    let values = rest.values()?;
    rest.options([])?;
    let numbers = values.iter().map(|&token| rest.number(token)).collect::<Result<Vec<f64>, _>>()?;
    read(token, &values, &numbers)
}

/// Returns an error about the values of a waveform.
fn refuse(token: Token<'_>, detail: &str, expected: &str) -> NetlistError {
    NetlistError::new(token, "malformed_source", detail.to_owned(), expected)
}

fn at(numbers: &[f64], k: usize) -> f64 {
    numbers.get(k).copied().unwrap_or(0.0)
}

fn sine(token: Token<'_>, _: &[Token<'_>], numbers: &[f64]) -> Result<Expression, NetlistError> {
    if !(3..=6).contains(&numbers.len()) {
        let expected = "SIN(offset amplitude hertz delay damping degrees), the first three at least";
        return Err(refuse(token, &format!("SIN has {} values", numbers.len()), expected));
    }
    let [offset, amplitude, hertz, delay, damping, degrees] = std::array::from_fn(|k| at(numbers, k));
    let time = if delay > 0.0 { format!("max(t - ({delay:?}), 0)") } else { "t".to_owned() };
    let phase = degrees * PI / 180.0;
    let decay = if damping == 0.0 { String::new() } else { format!("*exp(-({damping:?})*{time})") };
    Ok(Expression::Text(format!("({offset:?}) + ({amplitude:?})*sin(2*pi*({hertz:?})*{time} + ({phase:?})){decay}")))
}

fn pulse(token: Token<'_>, values: &[Token<'_>], numbers: &[f64]) -> Result<Expression, NetlistError> {
    const EXPECTED: &str = "PULSE(low high delay rise fall width period), the first two at least";
    if !(2..=7).contains(&numbers.len()) {
        return Err(refuse(token, &format!("PULSE has {} values", numbers.len()), EXPECTED));
    }
    if let Some(k) = (2..numbers.len()).find(|&k| numbers[k] < 0.0) {
        return Err(refuse(values[k], "a time of PULSE is below zero", EXPECTED));
    }
    let [low, high, delay, rise, fall] = std::array::from_fn(|k| at(numbers, k));
    let height = high - low;
    let Some(&width) = numbers.get(5) else {
        let rise = ramp(&format!("t - ({delay:?})"), rise);
        return Ok(Expression::Text(format!("({low:?}) + ({height:?})*{rise}")));
    };
    let length = rise + width + fall;
    let (since, gate) = match numbers.get(6) {
        None => (format!("t - ({delay:?})"), String::new()),
        Some(&period) if period >= length && period > 0.0 => {
            // Time since the start of the nearest pulse of the source, wrapped half a period after the middle of the
            // pulse, where the source is low.
            let middle = delay + 0.5 * length;
            let turns = 2.0 * PI / period;
            let angle = format!("({turns:?})*(t - ({middle:?}))");
            let since = format!("atan2(sin({angle}), cos({angle}))/({turns:?}) + ({:?})", 0.5 * length);
            let before = delay - 0.25 * (period - length);
            let gate = if delay > 0.0 { format!("*heaviside(t - ({before:?}))") } else { String::new() };
            (since, gate)
        }
        Some(_) => {
            let detail = "the period of PULSE is shorter than its rise, width and fall together";
            return Err(refuse(values[6], detail, "a period above 0, and no less than that sum"));
        }
    };
    let up = ramp(&since, rise);
    let down = ramp(&format!("{since} - ({:?})", rise + width), fall);
    Ok(Expression::Text(format!("({low:?}) + ({height:?})*({up} - {down}){gate}")))
}

fn piecewise_linear(token: Token<'_>, values: &[Token<'_>], numbers: &[f64]) -> Result<Expression, NetlistError> {
    const EXPECTED: &str = "PWL(time value time value ..), times in order";
    let count = numbers.len();
    if count < 2 || !count.is_multiple_of(2) || count > 2 * MOST_POINTS {
        let detail = format!("PWL has {count} values, not pairs of a time and a value, at most {MOST_POINTS} of them");
        return Err(refuse(token, &detail, EXPECTED));
    }
    if let Some(k) = (2..count).step_by(2).find(|&k| numbers[k] < numbers[k - 2]) {
        return Err(refuse(values[k], "the times of PWL decrease", EXPECTED));
    }
    let mut sum = format!("({:?})", numbers[1]);
    for k in (2..count).step_by(2) {
        let ramp = ramp(&format!("t - ({:?})", numbers[k - 2]), numbers[k] - numbers[k - 2]);
        sum += &format!(" + ({:?})*{ramp}", numbers[k + 1] - numbers[k - 1]);
    }
    Ok(Expression::Text(sum))
}

fn exponential(token: Token<'_>, values: &[Token<'_>], numbers: &[f64]) -> Result<Expression, NetlistError> {
    const EXPECTED: &str =
        "EXP(low high delay constant delay_back constant_back), the first four at least; constants above 0";
    let &[low, high, delay, constant, ref back @ ..] = numbers else {
        return Err(refuse(token, &format!("EXP has {} values", numbers.len()), EXPECTED));
    };
    let height = high - low;
    let term = |delay: f64, constant: f64| format!("(1 - exp(-max(t - ({delay:?}), 0)/({constant:?})))");
    let back = match back {
        [] => String::new(),
        &[delay_back, constant_back] if constant_back > 0.0 => format!(" - {}", term(delay_back, constant_back)),
        _ => {
            return Err(refuse(
                values.last().copied().unwrap_or(token),
                "the return of EXP needs a delay and a time constant above 0",
                EXPECTED,
            ));
        }
    };
    if constant <= 0.0 {
        return Err(refuse(values[3], "a time constant of EXP is not above zero", EXPECTED));
    }
    Ok(Expression::Text(format!("({low:?}) + ({height:?})*({}{back})", term(delay, constant))))
}

/// Returns a ramp from 0 at `since = 0` to 1 at `since = duration`, as an expression.
fn ramp(since: &str, duration: f64) -> String {
    if duration > 0.0 { format!("min(max(({since})/({duration:?}), 0), 1)") } else { format!("heaviside({since})") }
}
