// Numbers in the form in which people read them.

// Formats a number with about `digits` significant digits, and with a power of ten only if needed.
export function number(value, digits = 5) {
  if (value == null) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const whole = Number.isInteger(value);
  if (size < 1e-4 || size >= (whole ? 1e7 : 10 ** digits)) {
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    return `${trimmed(mantissa)}e${Number(exponent)}`;
  }
  return whole ? value.toLocaleString("en").replaceAll(",", "\u202f") : trimmed(value.toPrecision(digits));
}

// Removes trailing zeros from a formatted number. Rounding may have carried the number into the next power of ten.
const trimmed = (text) => (text.includes("e") ? String(Number(text)) : text.includes(".") ? text.replace(/\.?0+$/, "") : text);

// Formats a measured value of a check of the solution beside its allowed value. JSON has no infinity: the largest
// number stands for it.
export const measured = ({ value, allowed }) => {
  const told = Math.abs(value) === Number.MAX_VALUE ? "not finite" : number(value, 3);
  return `${told}, allowed ${number(allowed, 3)}`;
};

export function seconds(value) {
  if (value < 1e-3) return `${number(value * 1e6, 3)} µs`;
  if (value < 1) return `${number(value * 1e3, 3)} ms`;
  return `${number(value, 3)} s`;
}

// Formats the ticks of an axis: with one common power of ten, and with as many digits as their step has.
export function ticks(values) {
  if (values.length === 0) return [];
  const largest = Math.max(...values.map(Math.abs));
  const plain = largest === 0 || (largest >= 1e-3 && largest < 1e5);
  const exponent = plain ? 0 : 3 * Math.floor(Math.log10(largest) / 3);
  const scaled = values.map((value) => value / 10 ** exponent);
  const digits = digitsOf(values.length > 1 ? Math.abs(scaled[1] - scaled[0]) : Math.abs(scaled[0]));
  return scaled.map((value) => (value === 0 ? "0" : `${value.toFixed(digits)}${plain ? "" : `e${exponent}`}`));
}

const MOST_DIGITS = 12;

function digitsOf(step) {
  let digits = 0;
  const isWhole = (value) => Math.abs(value - Math.round(value)) <= 1e-6 * value;
  while (digits < MOST_DIGITS && !isWhole(step * 10 ** digits)) digits += 1;
  return digits;
}
