//! A straight program for several nodes of a graph. Each instruction writes the next register. Terms are ordered by
//! depth, then by operator and shape: those that agree in all three do not depend on each other, and where there are
//! many, as in the rows of a discretised partial differential equation, they run as lanes without a dispatch for each.

use super::graph::{Graph, Node, Term};
use super::lanes::Lanes;
use super::operator::Operator;
use rustc_hash::{FxBuildHasher, FxHashMap};
use std::hash::BuildHasher;
use std::mem::take;
use std::sync::Arc;

/// From this number on, terms of one kind run as lanes; for fewer the staging of operands costs more than it saves.
const FEWEST_LANES: usize = 24;

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

/// What a tape computes, and where: shared by all its copies.
#[derive(Debug, Default)]
pub(super) struct Program {
    blocks: Vec<Block>,
    pub(super) inputs: usize,
    /// The register of the first instruction.
    pub(super) first: usize,
    pub(super) outputs: Vec<u32>,
}

/// A compiled program of several outputs, with registers of its own: evaluation does not allocate, and a copy shares the
/// program. The default has no outputs.
#[derive(Clone, Debug, Default)]
pub struct Tape {
    pub(super) program: Arc<Program>,
    /// The inputs, the constants, then one for each instruction.
    pub(super) registers: Vec<f64>,
}

impl Tape {
    /// A program that computes `outputs`, and of the terms of `graph` only those that they need.
    pub fn compile(graph: &Graph, outputs: &[Node]) -> Self {
        let steps = steps(graph, outputs);
        let inputs = steps.iter().filter_map(|(_, node)| match graph.terms[node.place()] {
            Term::Input(index) => Some(index + 1),
            _ => None,
        });
        let inputs = inputs.max().unwrap_or(0);

        let mut registers = vec![0.0; inputs];
        let mut register_of = FxHashMap::default();
        let mut instructions = Vec::new();
        for &(kind, node) in &steps {
            let register = match graph.terms[node.place()] {
                Term::Input(index) => index,
                Term::Constant(bits) => {
                    registers.push(f64::from_bits(bits));
                    registers.len() - 1
                }
                Term::Apply(operator, a, b) => {
                    let instruction = Instruction { operator, a: register_of[&a], b: register_of[&b] };
                    instructions.push((kind, instruction));
                    registers.push(0.0);
                    registers.len() - 1
                }
            };
            register_of.insert(node, u32::try_from(register).expect("a graph has fewer than 2^32 terms"));
        }
        let program = Program {
            blocks: blocks(&instructions),
            first: registers.len() - instructions.len(),
            inputs,
            outputs: outputs.iter().map(|node| register_of[node]).collect(),
        };
        Self { program: Arc::new(program), registers }
    }

    /// Writes the values of the outputs where the first input is `first`, mostly time, and the others are `rest`, which
    /// reach at least to the largest index that occurs. Equal inputs give equal bits. What is not defined comes out as
    /// NaN or an infinity.
    pub fn evaluate(&mut self, first: f64, rest: &[f64], outputs: &mut [f64]) {
        let Self { program, registers } = self;
        debug_assert_eq!(outputs.len(), program.outputs.len(), "as many outputs as were compiled");
        let registers = registers.as_mut_slice();
        if let Some((input, inputs)) = registers[..program.inputs].split_first_mut() {
            *input = first;
            inputs.copy_from_slice(&rest[..inputs.len()]);
        }
        let mut next = program.first;
        for block in &program.blocks {
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
        for (output, &register) in outputs.iter_mut().zip(&program.outputs) {
            *output = registers[register as usize];
        }
    }

    /// Visits the operations in order, each with the registers of its operands.
    pub(super) fn for_each_operation(&self, mut visit: impl FnMut(Operator, usize, usize)) {
        for block in &self.program.blocks {
            match block {
                Block::Scalars(instructions) => {
                    for &Instruction { operator, a, b } in instructions {
                        visit(operator, a as usize, b as usize);
                    }
                }
                Block::Lanes(lanes) => lanes.for_each_operation(&mut visit),
            }
        }
    }

    /// The number of operations of one evaluation.
    pub fn instructions(&self) -> usize {
        self.registers.len() - self.program.first
    }
}

/// What terms that can be computed together have in common.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    /// The length of the longest path below: terms of one depth do not depend on each other.
    depth: u32,
    operator: Option<Operator>,
    /// A hash of the operators below. Terms of one shape made row by row have operands that stand side by side.
    shape: u64,
}

impl Kind {
    fn of(term: Term, kinds: &FxHashMap<Node, Self>) -> Self {
        let Term::Apply(operator, a, b) = term else {
            return Self { shape: u64::from(matches!(term, Term::Input(_))), ..Self::default() };
        };
        let (a, b) = (kinds[&a], kinds[&b]);
        let shape = FxBuildHasher.hash_one((operator, a.shape, b.shape));
        Self { depth: 1 + a.depth.max(b.depth), operator: Some(operator), shape }
    }
}

/// All terms that the outputs need, operands first, those of one kind together.
fn steps(graph: &Graph, outputs: &[Node]) -> Vec<(Kind, Node)> {
    let mut nodes = graph.terms_below(outputs);
    nodes.sort_unstable();
    let mut kinds = FxHashMap::default();
    let mut steps = Vec::with_capacity(nodes.len());
    for node in nodes {
        let kind = Kind::of(graph.terms[node.place()], &kinds);
        kinds.insert(node, kind);
        steps.push((kind, node));
    }
    steps.sort_unstable();
    steps
}

/// The instructions, with their kinds, cut where lanes begin and end.
fn blocks(instructions: &[(Kind, Instruction)]) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut scalars = Vec::new();
    for alike in instructions.chunk_by(|(one, _), (other, _)| one == other) {
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
