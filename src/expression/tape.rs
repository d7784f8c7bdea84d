//! A straight program for several nodes of a graph: each instruction writes the next register, and terms that have
//! the same depth and operator stand together. Where many do they run as lanes, without a dispatch for each.

use super::graph::{Graph, Node, Term};
use super::lanes::Lanes;
use super::operator::Operator;
use rustc_hash::FxHashMap;
use std::mem::take;

/// From this number on, terms of one depth and operator run as lanes.
const FEWEST_LANES: usize = 16;

/// `operator(registers[a], registers[b])`, for the next register.
#[derive(Clone, Copy, Debug)]
struct Instruction {
    operator: Operator,
    a: u32,
    b: u32,
}

#[derive(Clone, Debug)]
enum Block {
    /// One after the other.
    Scalars(Vec<Instruction>),
    /// All at once.
    Lanes(Lanes),
}

/// A compiled program of several outputs. It owns its registers: evaluation does not allocate.
#[derive(Clone, Debug)]
pub struct Tape {
    blocks: Vec<Block>,
    /// The inputs, the constants, then one for each instruction.
    registers: Vec<f64>,
    inputs: usize,
    /// The register of the first instruction.
    first: usize,
    outputs: Vec<u32>,
}

impl Tape {
    /// A program that computes `outputs`, and of the terms of `graph` only those that they need.
    pub fn compile(graph: &Graph, outputs: &[Node]) -> Self {
        let steps = steps(graph, outputs);
        let inputs = steps.iter().filter_map(|step| match step.term {
            Term::Input(index) => Some(index + 1),
            _ => None,
        });
        let inputs = inputs.max().unwrap_or(0);

        let mut registers = vec![0.0; inputs];
        let mut register_of = FxHashMap::default();
        let mut instructions = Vec::new();
        for step in &steps {
            let register = match step.term {
                Term::Input(index) => index,
                Term::Constant(bits) => {
                    registers.push(f64::from_bits(bits));
                    registers.len() - 1
                }
                Term::Apply(operator, a, b) => {
                    let instruction = Instruction { operator, a: register_of[&a], b: register_of[&b] };
                    instructions.push((step.depth, instruction));
                    registers.push(0.0);
                    registers.len() - 1
                }
            };
            register_of.insert(step.node, u32::try_from(register).expect("a graph has fewer than 2^32 terms"));
        }
        Self {
            blocks: blocks(&instructions),
            first: registers.len() - instructions.len(),
            registers,
            inputs,
            outputs: outputs.iter().map(|node| register_of[node]).collect(),
        }
    }

    /// Writes the values of the outputs at `inputs`, which has at least as many entries as the largest index that
    /// occurs demands. Equal inputs give equal bits.
    pub fn evaluate(&mut self, inputs: &[f64], outputs: &mut [f64]) {
        let registers = self.registers.as_mut_slice();
        registers[..self.inputs].copy_from_slice(&inputs[..self.inputs]);
        let mut next = self.first;
        for block in &self.blocks {
            match block {
                Block::Scalars(instructions) => {
                    for instruction in instructions {
                        let (a, b) = (registers[instruction.a as usize], registers[instruction.b as usize]);
                        registers[next] = instruction.operator.apply(a, b);
                        next += 1;
                    }
                }
                Block::Lanes(lanes) => {
                    let (known, unknown) = registers.split_at_mut(next);
                    lanes.evaluate(known, &mut unknown[..lanes.len()]);
                    next += lanes.len();
                }
            }
        }
        for (output, &register) in outputs.iter_mut().zip(&self.outputs) {
            *output = registers[register as usize];
        }
    }

    /// The number of operations of one evaluation.
    pub fn instructions(&self) -> usize {
        self.registers.len() - self.first
    }
}

/// A term to be computed, and the length of the longest path below it.
struct Step {
    depth: u32,
    term: Term,
    node: Node,
}

/// All terms that the outputs need, operands first, those of one depth and operator together.
fn steps(graph: &Graph, outputs: &[Node]) -> Vec<Step> {
    let mut nodes = graph.terms_below(outputs);
    nodes.sort_unstable();
    let mut depths: FxHashMap<Node, u32> = FxHashMap::default();
    let mut steps = Vec::with_capacity(nodes.len());
    for node in nodes {
        let term = graph.terms[node.place()];
        let depth = match term {
            Term::Apply(_, a, b) => 1 + depths[&a].max(depths[&b]),
            _ => 0,
        };
        depths.insert(node, depth);
        steps.push(Step { depth, term, node });
    }
    let operator = |step: &Step| match step.term {
        Term::Apply(operator, ..) => Some(operator),
        _ => None,
    };
    steps.sort_unstable_by_key(|step| (step.depth, operator(step), step.node));
    steps
}

/// The instructions, with their depths, cut where lanes begin and end.
fn blocks(instructions: &[(u32, Instruction)]) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut scalars = Vec::new();
    for alike in instructions.chunk_by(|one, other| one.0 == other.0 && one.1.operator == other.1.operator) {
        let operator = alike[0].1.operator;
        let alike = alike.iter().map(|&(_, instruction)| instruction);
        if alike.len() < FEWEST_LANES {
            scalars.extend(alike);
            continue;
        }
        if !scalars.is_empty() {
            blocks.push(Block::Scalars(take(&mut scalars)));
        }
        let (a, b): (Vec<u32>, Vec<u32>) = alike.map(|instruction| (instruction.a, instruction.b)).unzip();
        blocks.push(Block::Lanes(Lanes::new(operator, a, b)));
    }
    if !scalars.is_empty() {
        blocks.push(Block::Scalars(scalars));
    }
    blocks
}
