//! Evaluation of a program at several points at once, such as the stages of a step. Each instruction is dispatched once
//! for all points, and its arithmetic is vectorised by the compiler. Results are bitwise equal to single evaluations.

use super::tape::{Block, Instruction, Tape};

/// The maximum number of points evaluated at once: a register is then one cache line.
pub const MOST_LANES: usize = 8;

/// The registers of a program for its evaluation at several points at once.
#[derive(Clone, Debug, Default)]
pub(super) struct Wide {
    /// The number of points per register; zero until the constants of the program have been copied to the registers.
    lanes: usize,
    registers: Vec<f64>,
}

impl Wide {
    /// Invalidates the copied constants of the program, which new parameter values may have changed.
    pub(super) fn forget(&mut self) {
        self.lanes = 0;
    }

    /// Returns the registers at `L` points; constants are copied from the registers `single` of one point.
    fn registers<const L: usize>(&mut self, single: &[f64]) -> &mut [[f64; L]] {
        if self.lanes != L {
            self.lanes = L;
            self.registers.clear();
            self.registers.extend(single.iter().flat_map(|&value| [value; L]));
        }
        self.registers.as_chunks_mut().0
    }
}

impl Tape {
    /// Evaluates the outputs at several points at once, bitwise equal to [`Tape::evaluate`]. `first` contains the
    /// first input of each point, `rest` the other inputs, concatenated with equal numbers per point; `outputs` are
    /// concatenated by point.
    pub fn evaluate_points(&mut self, first: &[f64], rest: &[f64], outputs: &mut [f64]) {
        let (stride, width) = (rest.len() / first.len().max(1), self.program.outputs.len());
        debug_assert_eq!(outputs.len(), first.len() * width, "as many outputs as were compiled, at each point");
        for begin in (0..first.len()).step_by(MOST_LANES) {
            let end = first.len().min(begin + MOST_LANES);
            let (first, rest) = (&first[begin..end], &rest[stride * begin..stride * end]);
            let outputs = &mut outputs[width * begin..width * end];
            match end - begin {
                // Programs most of whose instructions are vectorised over many similar terms gain nothing from
                // vectorisation over points.
                _ if self.program.is_vectorised => self.evaluate_each(first, rest, outputs),
                1 => self.evaluate(first[0], rest, outputs),
                // Two to four points share four lanes: the narrowest vector registers of processors have two lanes.
                2..=4 => self.evaluate_lanes::<4>(first, rest, outputs),
                5 | 6 => self.evaluate_lanes::<6>(first, rest, outputs),
                _ => self.evaluate_lanes::<MOST_LANES>(first, rest, outputs),
            }
        }
    }

    /// Evaluates the program at the points one after the other.
    fn evaluate_each(&mut self, first: &[f64], rest: &[f64], outputs: &mut [f64]) {
        let (stride, width) = (rest.len() / first.len(), self.program.outputs.len());
        for (point, &first) in first.iter().enumerate() {
            self.evaluate(first, &rest[stride * point..][..stride], &mut outputs[width * point..][..width]);
        }
    }

    /// Evaluates the program at up to `L` points at once.
    fn evaluate_lanes<const L: usize>(&mut self, first: &[f64], rest: &[f64], outputs: &mut [f64]) {
        let mut wide = std::mem::take(&mut self.wide);
        let registers = wide.registers::<L>(&self.registers);
        let count = first.len();
        if let Some((input, inputs)) = registers[..self.program.inputs].split_first_mut() {
            let stride = rest.len() / count;
            for lane in 0..L {
                // If there are fewer points than the `L` lanes of a register, the other lanes repeat the first point.
                let point = if lane < count { lane } else { 0 };
                input[lane] = first[point];
                let rest = &rest[stride * point..][..inputs.len()];
                inputs.iter_mut().zip(rest).for_each(|(input, rest)| input[lane] = *rest);
            }
        }
        let mut next = self.program.first;
        for block in &self.program.blocks {
            match block {
                Block::Scalars(instructions) => {
                    for instruction in instructions {
                        let (known, unknown) = registers.split_at_mut(next);
                        let (a, b) = (&known[instruction.a as usize], &known[instruction.b as usize]);
                        instruction.operator.apply_lanes(a, b, &mut unknown[0], count);
                        next += 1;
                    }
                }
                Block::Lanes(lanes) => {
                    let (known, unknown) = registers.split_at_mut(next);
                    lanes.evaluate_points(known, &mut unknown[..lanes.len()], count);
                    next += lanes.len();
                }
                Block::Lookups(instructions) => {
                    for &Instruction { operator, a, b } in instructions {
                        let (a, b) = (registers[a as usize], registers[b as usize]);
                        for lane in 0..count {
                            registers[next][lane] = self.program.tables.apply(operator, a[lane], b[lane]);
                        }
                        next += 1;
                    }
                }
            }
        }
        let width = self.program.outputs.len();
        for lane in 0..count {
            let outputs = outputs[width * lane..][..width].iter_mut();
            outputs.zip(&self.program.outputs).for_each(|(output, &at)| *output = registers[at as usize][lane]);
        }
        self.wide = wide;
    }
}
