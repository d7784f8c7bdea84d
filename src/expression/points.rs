//! A whole program at several points side by side, as at the stages of a step: each instruction is dispatched once for all
//! of them, and its arithmetic is vectorised by the compiler. Each result has the bits of a single evaluation.

use super::tape::Tape;

/// The most points that are evaluated side by side: two lines of a cache a register would gain no more.
const MOST_LANES: usize = 8;

/// The registers of a program, each at several points.
#[derive(Clone, Debug, Default)]
pub(super) struct Wide {
    /// The points of each; none before the constants are in their registers.
    lanes: usize,
    registers: Vec<f64>,
}

impl Wide {
    /// Has the constants taken anew, which parameters may have changed.
    pub(super) fn forget(&mut self) {
        self.lanes = 0;
    }

    /// The registers at `L` points, of a program whose registers at one are given.
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
    /// Writes what [`Tape::evaluate`] would at several points, one after the other, with the same bits: `first` has the first
    /// input of each, and `rest` the others, as many of each.
    pub fn evaluate_points(&mut self, first: &[f64], rest: &[f64], outputs: &mut [f64]) {
        let (stride, width) = (rest.len() / first.len().max(1), self.program.outputs.len());
        debug_assert_eq!(outputs.len(), first.len() * width, "as many outputs as were compiled, at each point");
        for begin in (0..first.len()).step_by(MOST_LANES) {
            let end = first.len().min(begin + MOST_LANES);
            let (first, rest) = (&first[begin..end], &rest[stride * begin..stride * end]);
            let outputs = &mut outputs[width * begin..width * end];
            // The narrowest vectors of processors have two lanes.
            match end - begin {
                1 => self.evaluate(first[0], rest, outputs),
                2..=4 => self.evaluate_lanes::<4>(first, rest, outputs),
                5 | 6 => self.evaluate_lanes::<6>(first, rest, outputs),
                _ => self.evaluate_lanes::<MOST_LANES>(first, rest, outputs),
            }
        }
    }

    /// The same at no more than `L` points.
    fn evaluate_lanes<const L: usize>(&mut self, first: &[f64], rest: &[f64], outputs: &mut [f64]) {
        let mut wide = std::mem::take(&mut self.wide);
        let registers = wide.registers::<L>(&self.registers);
        let count = first.len();
        let stride = rest.len() / count;
        if let Some((input, inputs)) = registers[..self.program.inputs].split_first_mut() {
            input[..count].copy_from_slice(first);
            for lane in 0..count {
                let values = &rest[stride * lane..][..inputs.len()];
                inputs.iter_mut().zip(values).for_each(|(input, value)| input[lane] = *value);
            }
        }
        let mut next = self.program.first;
        self.for_each_operation(|operator, a, b| {
            registers[next] = operator.apply_lanes(&registers[a], &registers[b], count);
            next += 1;
        });
        let width = self.program.outputs.len();
        for lane in 0..count {
            let outputs = outputs[width * lane..][..width].iter_mut();
            outputs.zip(&self.program.outputs).for_each(|(output, &at)| *output = registers[at as usize][lane]);
        }
        self.wide = wide;
    }
}
