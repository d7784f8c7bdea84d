//! A straight-line program for several nodes of a graph. Each instruction writes the next register. Terms are ordered
//! by depth, operator and shape. Terms that agree in all three are independent of each other; if there are many, as
//! in the rows of a discretised partial differential equation, they are evaluated as lanes with a single dispatch.
//!
//! Terms in parameters alone are computed once, when parameters are bound, and are constants for evaluations.

use super::graph::{Graph, Node, Term};
use super::lanes::Lanes;
use super::operator::Operator;
use super::points::Wide;
use super::table::Tables;
use rustc_hash::{FxBuildHasher, FxHashMap};
use std::hash::BuildHasher;
use std::mem::take;
use std::sync::Arc;

/// The smallest number of terms of one kind (same depth and operator, and so independent) that are evaluated together
/// by vector instructions; for fewer terms, the copying of operands costs more than it saves.
const FEWEST_LANES: usize = 24;

/// An instruction of a program: writes `operator(registers[a], registers[b])` to the next register.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instruction {
    pub(super) operator: Operator,
    pub(super) a: u32,
    pub(super) b: u32,
}

#[derive(Clone, Debug)]
pub(super) enum Block {
    /// A block of instructions that are evaluated one after the other.
    Scalars(Vec<Instruction>),
    /// A block of instructions with one operator that are independent of each other and evaluated at once.
    Lanes(Lanes),
    /// A block of table lookups, evaluated one after the other.
    Lookups(Vec<Instruction>),
}

/// The instructions of a tape (compiled expressions), shared by all its copies.
#[derive(Debug, Default)]
pub(super) struct Program {
    pub(super) blocks: Vec<Block>,
    /// The parameters that occur in the program, by index, with their registers.
    parameters: Vec<(usize, usize)>,
    /// The instructions for terms in parameters alone, with the registers of their results.
    prelude: Vec<(usize, Instruction)>,
    pub(super) inputs: usize,
    /// Whether most instructions are evaluated together by vector instructions even at a single point, because their
    /// terms have one kind.
    pub(super) is_vectorised: bool,
    /// The register that the first instruction of the program writes; each further instruction writes the next one.
    pub(super) first: usize,
    pub(super) outputs: Vec<u32>,
    /// The tables used by the program.
    pub(super) tables: Tables,
}

/// A compiled program with several outputs and its own registers. Evaluation does not allocate; copies share the
/// program. The default has no outputs.
#[derive(Clone, Debug, Default)]
pub struct Tape {
    pub(super) program: Arc<Program>,
    /// Registers of inputs, of constants and terms in parameters, then one per instruction.
    pub(super) registers: Vec<f64>,
    /// The registers of the program for its evaluation at several points at once.
    pub(super) wide: Wide,
}

impl Tape {
    /// Compiles `outputs` and the terms of `graph` that they need. Parameters are bound to their given values.
    pub fn compile(graph: &Graph, outputs: &[Node]) -> Self {
        let steps = steps(graph, outputs);
        let inputs = steps.iter().filter_map(|(_, node)| match graph.terms[node.place()] {
            Term::Input(index) => Some(index + 1),
            _ => None,
        });
        let mut assembly = Assembly::new(graph, inputs.max().unwrap_or(0));
        assembly.prelude(&steps);
        steps.iter().for_each(|&(kind, node)| assembly.take(kind, node));
        let outputs = outputs.iter().map(|&node| assembly.register(node)).collect();
        let Assembly { registers, parameters, prelude, instructions, inputs, .. } = assembly;
        let blocks = blocks(&instructions);
        let in_lanes: usize =
            blocks.iter().map(|block| if let Block::Lanes(lanes) = block { lanes.len() } else { 0 }).sum();
        let program = Program {
            blocks,
            is_vectorised: 2 * in_lanes > instructions.len(),
            parameters,
            prelude,
            first: registers.len() - instructions.len(),
            inputs,
            outputs,
            tables: graph.tables.clone(),
        };
        Self { program: Arc::new(program), registers, wide: Wide::default() }
    }

    /// Binds new parameter values, which must extend to the largest index that occurs.
    pub fn bind(&mut self, parameters: &[f64]) {
        let Self { program, registers, wide } = self;
        wide.forget();
        for &(index, register) in &program.parameters {
            registers[register] = parameters[index];
        }
        for &(target, Instruction { operator, a, b }) in &program.prelude {
            registers[target] = program.tables.apply(operator, registers[a as usize], registers[b as usize]);
        }
    }

    /// Evaluates the outputs for the first input `first` (usually time) and the other inputs `rest`, which must extend
    /// to the largest index that occurs. Results are reproducible bitwise. Undefined values are NaN or infinite.
    pub fn evaluate(&mut self, first: f64, rest: &[f64], outputs: &mut [f64]) {
        let Self { program, registers, .. } = self;
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
                Block::Lookups(instructions) => {
                    for &Instruction { operator, a, b } in instructions {
                        registers[next] = program.tables.apply(operator, registers[a as usize], registers[b as usize]);
                        next += 1;
                    }
                }
            }
        }
        for (output, &register) in outputs.iter_mut().zip(&program.outputs) {
            *output = registers[register as usize];
        }
    }

    /// Returns the largest absolute value of all finite intermediate results of the last evaluation.
    pub fn largest(&self) -> f64 {
        self.registers.iter().filter(|value| value.is_finite()).fold(0.0, |largest, value| largest.max(value.abs()))
    }

    /// Visits the operations of the program in order, each with the registers of its operands.
    pub(super) fn for_each_operation(&self, mut visit: impl FnMut(Operator, usize, usize)) {
        for block in &self.program.blocks {
            match block {
                Block::Scalars(instructions) | Block::Lookups(instructions) => {
                    for &Instruction { operator, a, b } in instructions {
                        visit(operator, a as usize, b as usize);
                    }
                }
                Block::Lanes(lanes) => lanes.for_each_operation(&mut visit),
            }
        }
    }

    /// Returns the number of operations of one evaluation of the program.
    pub fn instructions(&self) -> usize {
        self.registers.len() - self.program.first
    }
}

/// The state of the compilation of a program.
struct Assembly<'g> {
    graph: &'g Graph,
    inputs: usize,
    registers: Vec<f64>,
    register_of: FxHashMap<Node, u32>,
    parameters: Vec<(usize, usize)>,
    prelude: Vec<(usize, Instruction)>,
    instructions: Vec<(Kind, Instruction)>,
}

impl<'g> Assembly<'g> {
    fn new(graph: &'g Graph, inputs: usize) -> Self {
        Self {
            graph,
            inputs,
            registers: vec![0.0; inputs],
            register_of: FxHashMap::default(),
            parameters: Vec::new(),
            prelude: Vec::new(),
            instructions: Vec::new(),
        }
    }

    /// Adds the constants and the terms in parameters alone that the terms `steps` of the program need, operands
    /// first.
    fn prelude(&mut self, steps: &[(Kind, Node)]) {
        let known = steps.iter().map(|&(_, node)| node).filter(|node| self.graph.known.contains_key(node));
        let mut terms = self.graph.computed_below(&known.collect::<Vec<_>>());
        terms.sort_unstable();
        // Give computed terms consecutive registers, so that the operands of terms that are evaluated together are
        // contiguous.
        let (computed, given): (Vec<Node>, Vec<Node>) =
            terms.into_iter().partition(|node| matches!(self.graph.terms[node.place()], Term::Apply(..)));
        for node in given {
            if let Term::Parameter(index) = self.graph.terms[node.place()] {
                self.parameters.push((index, self.registers.len()));
            }
            self.keep(node, self.graph.value(node).unwrap_or(f64::NAN));
        }
        for node in computed {
            let Term::Apply(operator, a, b) = self.graph.terms[node.place()] else { continue };
            if operator != Operator::Expanded {
                let instruction = Instruction { operator, a: self.register(a), b: self.register(b) };
                self.prelude.push((self.registers.len(), instruction));
                self.keep(node, self.graph.value(node).unwrap_or(f64::NAN));
            }
        }
    }

    /// Adds to the program the instruction that computes a term, unless the term has a register already, as a constant
    /// or a term in parameters alone.
    fn take(&mut self, kind: Kind, node: Node) {
        if self.register_of.contains_key(&node) {
            return;
        }
        match self.graph.terms[node.place()] {
            Term::Input(index) => {
                self.register_of.insert(node, narrow(index));
            }
            Term::Apply(Operator::Expanded, ..) => {}
            Term::Apply(operator, a, b) => {
                let instruction = Instruction { operator, a: self.register(a), b: self.register(b) };
                self.instructions.push((kind, instruction));
                self.keep(node, 0.0);
            }
            Term::Constant(_) | Term::Parameter(_) => self.keep(node, self.graph.value(node).unwrap_or(f64::NAN)),
        }
    }

    /// Returns the register of a term; for an expanded power, that of its product.
    fn register(&self, mut node: Node) -> u32 {
        while let Term::Apply(Operator::Expanded, a, _) = self.graph.terms[node.place()] {
            node = a;
        }
        self.register_of[&node]
    }

    /// Allocates a register for a term.
    fn keep(&mut self, node: Node, value: f64) {
        self.register_of.insert(node, narrow(self.registers.len()));
        self.registers.push(value);
    }
}

/// Converts an index to `u32`.
fn narrow(place: usize) -> u32 {
    u32::try_from(place).expect("a graph has fewer than 2^32 terms")
}

/// The kind of a term: terms of one kind are independent and can be evaluated together.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    /// The length of the longest path below the term: terms of equal depth are independent of each other.
    depth: u32,
    operator: Option<Operator>,
    /// A hash of the operators below the term. Terms of equal shape, created row by row, have contiguous operands.
    shape: u64,
}

impl Kind {
    fn of(graph: &Graph, node: Node, kinds: &FxHashMap<Node, Self>) -> Self {
        let Some((operator, a, b)) = graph.operation(node) else {
            let is_input = matches!(graph.terms[node.place()], Term::Input(_));
            return Self { shape: u64::from(is_input), ..Self::default() };
        };
        if operator == Operator::Expanded {
            return kinds[&a];
        }
        let (a, b) = (kinds[&a], kinds[&b]);
        let shape = FxBuildHasher.hash_one((operator, a.shape, b.shape));
        Self { depth: 1 + a.depth.max(b.depth), operator: Some(operator), shape }
    }
}

/// Returns all terms that the outputs of a program need, operands first, grouped by kind.
fn steps(graph: &Graph, outputs: &[Node]) -> Vec<(Kind, Node)> {
    let mut nodes = graph.terms_below(outputs);
    nodes.sort_unstable();
    let mut kinds = FxHashMap::default();
    let mut steps = Vec::with_capacity(nodes.len());
    for node in nodes {
        let kind = Kind::of(graph, node, &kinds);
        kinds.insert(node, kind);
        steps.push((kind, node));
    }
    steps.sort_unstable();
    steps
}

/// Divides the instructions of a program into blocks: those evaluated one after the other, those evaluated at once, and
/// table lookups.
fn blocks(instructions: &[(Kind, Instruction)]) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut scalars = Vec::new();
    for alike in instructions.chunk_by(|(one, _), (other, _)| one == other) {
        let operator = alike[0].1.operator;
        let alike = alike.iter().map(|&(_, instruction)| instruction);
        if alike.len() < FEWEST_LANES && !operator.takes_table() {
            scalars.extend(alike);
            continue;
        }
        if !scalars.is_empty() {
            blocks.push(Block::Scalars(take(&mut scalars)));
        }
        if operator.takes_table() {
            blocks.push(Block::Lookups(alike.collect()));
            continue;
        }
        let (a, b): (Vec<u32>, Vec<u32>) = alike.map(|instruction| (instruction.a, instruction.b)).unzip();
        blocks.push(Block::Lanes(Lanes::new(operator, a, b)));
    }
    if !scalars.is_empty() {
        blocks.push(Block::Scalars(scalars));
    }
    blocks
}
