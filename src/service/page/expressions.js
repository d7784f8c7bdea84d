// Expressions of a specification, evaluated in the browser for pictures only: every number of an answer comes from
// the service.
//
// The grammar is that of the service: `+ - * / ^` (right associative, binding more tightly than the sign), calls,
// `x[i]`, conditions inside `if`. An expression that cannot be parsed gives null, and the picture omits what depends
// on it.

const TOKEN = /\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_][A-Za-z_0-9]*(?:\.[A-Za-z_][A-Za-z_0-9]*)*(?:\[[^\]]*\])?)|(\*\*|<=|>=|==|!=|[-+*/^(),<>]))/y;

const mod = (a, b) => a - b * Math.floor(a / b);

const FUNCTIONS = {
  sin: Math.sin, cos: Math.cos, tan: Math.tan, asin: Math.asin, acos: Math.acos, atan: Math.atan, atan2: Math.atan2,
  sinh: Math.sinh, cosh: Math.cosh, tanh: Math.tanh, exp: Math.exp, ln: Math.log, log10: Math.log10, sqrt: Math.sqrt,
  cbrt: Math.cbrt, abs: Math.abs, sign: Math.sign, min: Math.min, max: Math.max, pow: Math.pow,
  floor: Math.floor, ceil: Math.ceil, round: Math.round, mod,
  heaviside: (a) => (a >= 0 ? 1 : 0),
  if: (c, a, b) => (c ? a : b),
  pwm: (t, period, duty) => (mod(t, period) < duty * period ? 1 : 0),
  sawtooth: (t, period) => mod(t, period) / period,
  triangle: (t, period) => 1 - Math.abs(2 * (mod(t, period) / period) - 1),
  pulse: (t, start, width) => (t >= start && t < start + width ? 1 : 0),
};

// Compiles an expression of a specification to a function of a scope, which is an object or a function from names to
// numbers; returns null if the expression cannot be parsed.
export function compile(expression) {
  if (typeof expression === "number") return () => expression;
  if (typeof expression !== "string") return null;
  try {
    const reader = new Reader(expression);
    const node = reader.condition();
    return reader.token === null ? node : null;
  } catch {
    return null;
  }
}

// Returns the value of an expression with the values of names in `scope`; NaN if it has none.
export function value(expression, scope = {}) {
  const compiled = compile(expression);
  if (compiled === null) return NaN;
  try {
    return compiled((name) => scope[name]);
  } catch {
    return NaN;
  }
}

// Returns the values of the `parameters` of a specification, each of which may be an expression in the others.
export function parameterValues(parameters = {}) {
  const values = {};
  for (let round = 0; round <= Object.keys(parameters).length; round += 1) {
    let found = false;
    for (const [name, expression] of Object.entries(parameters)) {
      if (name in values) continue;
      const one = value(expression, values);
      if (Number.isFinite(one)) [values[name], found] = [one, true];
    }
    if (!found) break;
  }
  return values;
}

class Reader {
  constructor(text) {
    this.text = text;
    this.at = 0;
    this.depth = 0;
    this.next();
  }

  next() {
    TOKEN.lastIndex = this.at;
    const match = TOKEN.exec(this.text);
    if (match === null) {
      if (this.text.slice(this.at).trim() !== "") throw new SyntaxError();
      this.token = null;
      return;
    }
    this.at = TOKEN.lastIndex;
    const [, number, name, operator] = match;
    this.token = number !== undefined ? { number: Number(number) } : name !== undefined ? { name } : { operator };
  }

  is(...operators) {
    return this.token !== null && operators.includes(this.token.operator ?? this.token.name);
  }

  expect(operator) {
    if (!this.is(operator)) throw new SyntaxError();
    this.next();
  }

  condition() {
    if ((this.depth += 1) > 200) throw new SyntaxError();
    let left = this.comparison();
    while (this.is("and", "or")) {
      const [word, first] = [this.token.name, left];
      this.next();
      const second = this.comparison();
      left = word === "and" ? (s) => first(s) && second(s) : (s) => first(s) || second(s);
    }
    this.depth -= 1;
    return left;
  }

  comparison() {
    if (this.is("not")) {
      this.next();
      const inner = this.comparison();
      return (s) => !inner(s);
    }
    const left = this.sum();
    if (!this.is("<", "<=", ">", ">=", "==", "!=")) return left;
    const { operator } = this.token;
    this.next();
    const right = this.sum();
    const compare = {
      "<": (a, b) => a < b, "<=": (a, b) => a <= b, ">": (a, b) => a > b, ">=": (a, b) => a >= b,
      "==": (a, b) => a === b, "!=": (a, b) => a !== b,
    }[operator];
    return (s) => compare(left(s), right(s));
  }

  sum() {
    let left = this.product();
    while (this.is("+", "-")) {
      const [plus, first] = [this.token.operator === "+", left];
      this.next();
      const second = this.product();
      left = plus ? (s) => first(s) + second(s) : (s) => first(s) - second(s);
    }
    return left;
  }

  product() {
    let left = this.signed();
    while (this.is("*", "/")) {
      const [times, first] = [this.token.operator === "*", left];
      this.next();
      const second = this.signed();
      left = times ? (s) => first(s) * second(s) : (s) => first(s) / second(s);
    }
    return left;
  }

  signed() {
    if (!this.is("+", "-")) return this.power();
    const minus = this.token.operator === "-";
    this.next();
    const inner = this.signed();
    return minus ? (s) => -inner(s) : inner;
  }

  power() {
    const base = this.atom();
    if (!this.is("^", "**")) return base;
    this.next();
    const exponent = this.signed();
    return (s) => base(s) ** exponent(s);
  }

  atom() {
    const { token } = this;
    if (token === null) throw new SyntaxError();
    this.next();
    if (token.number !== undefined) return () => token.number;
    if (token.operator === "(") {
      const inner = this.condition();
      this.expect(")");
      return inner;
    }
    if (token.name === undefined) throw new SyntaxError();
    if (!this.is("(")) {
      if (token.name === "pi") return () => Math.PI;
      return (scope) => {
        const found = scope(token.name);
        if (found === undefined) throw new ReferenceError(token.name);
        return found;
      };
    }
    return this.call(token.name);
  }

  // In the expressions of a circuit, `v(out)` is a name; every other word before parentheses is a function.
  call(name) {
    if (name === "v" || name === "i") {
      const close = this.text.indexOf(")", this.at);
      if (close === -1) throw new SyntaxError();
      const whole = `${name}(${this.text.slice(this.at, close).trim()})`;
      this.at = close + 1;
      this.next();
      return (scope) => scope(whole);
    }
    if (!Object.hasOwn(FUNCTIONS, name)) throw new ReferenceError(name);
    this.next();
    const taken = [this.condition()];
    while (this.is(",")) {
      this.next();
      taken.push(this.condition());
    }
    this.expect(")");
    return (scope) => FUNCTIONS[name](...taken.map((one) => one(scope)));
  }
}
