//! The model of a mechanical system: compiled equations with names and initial values.

use super::{Parameters, Slopes, SymbolicMechanics, Unbindable};
use analysis::{Analysis, Uniqueness};
use expression::{ExpressionError, Node};
use problem::Warning;
use problem::{Mechanical, MechanicalStructure};

/// A mechanical system with its names and initial values. It can be solved any number of times.
#[derive(Clone, Debug)]
pub struct MechanicalModel {
    /// The names of the generalised coordinates of the system.
    pub coordinates: Vec<String>,
    /// The names of the contacts of the system.
    pub contacts: Vec<String>,
    /// The names of the states of the system: coordinates, then velocities.
    pub state_names: Vec<String>,
    /// The names of all outputs of the system: states, then gap and accumulated impulses of each contact, then
    /// energies.
    pub output_names: Vec<String>,
    /// The initial coordinates `q` of the system, then its initial velocities `v`.
    pub initial: Vec<f64>,
    /// Warnings to the user about the mechanical system, known before the problem is solved.
    pub warnings: Vec<Warning>,
    /// Whether forces, masses, gaps, joint constraints or slip velocities of the system have kinks or jumps in
    /// coordinates or velocities.
    pub has_kinks: bool,
    /// Whether the user's initial state was projected onto the constraints, so that it is not a function of the
    /// parameters.
    pub is_start_moved: bool,
    /// The parameters of the problem, with the contact coefficients that depend on them; `None` if the problem has no
    /// parameters or if they were folded into constants.
    pub parameters: Option<(Parameters, Vec<ContactCoefficient>)>,
    system: SymbolicMechanics,
}

/// A coefficient of a contact law that depends on parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactCoefficient {
    /// The coefficient of friction of the contact with this index.
    Friction(usize),
    /// The coefficient of restitution of the contact with this index.
    Restitution(usize),
}

/// The names of the energy outputs of a mechanical system, in the order in which they are written.
pub const ENERGIES: [&str; 6] = [
    "kinetic_energy",
    "potential_energy",
    "work_of_forces",
    "work_of_drives",
    "dissipated_by_friction",
    "lost_in_impacts",
];

impl MechanicalModel {
    /// Builds the model of a mechanical system and the names of its states and outputs.
    pub fn new(
        coordinates: &[String],
        contacts: &[String],
        initial: Vec<f64>,
        system: SymbolicMechanics,
        warnings: Vec<Warning>,
    ) -> Self {
        let velocities = coordinates.iter().map(|name| velocity_name(name));
        let state_names: Vec<String> = coordinates.iter().cloned().chain(velocities).collect();
        let mut output_names = state_names.clone();
        for (name, contact) in contacts.iter().zip(&system.structure().contacts) {
            output_names.extend(["gap", "impulse"].map(|quantity| quantity_name(name, quantity)));
            match contact.slips {
                0 => {}
                1 => output_names.push(quantity_name(name, "friction")),
                slips => output_names.extend((1..=slips).map(|i| quantity_name(name, &format!("friction_{i}")))),
            }
        }
        output_names.extend(ENERGIES.map(String::from));
        Self {
            coordinates: coordinates.to_vec(),
            contacts: contacts.to_vec(),
            state_names,
            output_names,
            initial,
            warnings,
            has_kinks: false,
            is_start_moved: false,
            parameters: None,
            system,
        }
    }

    /// Returns a copy of the model with new parameter values, in the order of [`Parameters::names`]. Compiled
    /// programs are shared: nothing is parsed, differentiated or compiled.
    ///
    /// # Errors
    /// For a wrong number of values, values that are not finite or out of range, and values that would
    /// change the structure of the problem, which must then be compiled anew.
    pub fn with_parameters(&self, values: &[f64]) -> Result<Self, Unbindable> {
        let mut bound = self.clone();
        let Some((parameters, coefficients)) = &mut bound.parameters else { return Err(Unbindable::Folded) };
        let (all, constants) = parameters.checked(values)?;
        let (initial, of_contacts) = constants.split_at(bound.initial.len());
        for (&coefficient, &value) in coefficients.iter().zip(of_contacts) {
            let contacts = bound.system.contacts_mut();
            let (place, name, most, contact) = match coefficient {
                ContactCoefficient::Friction(k) => (&mut contacts[k].mu, "friction", f64::MAX, k),
                ContactCoefficient::Restitution(k) => (&mut contacts[k].restitution, "restitution", 1.0, k),
            };
            if !(0.0..=most).contains(&value) {
                let what = format!("the coefficient of {name} of `{}` is {value}", bound.contacts[contact]);
                return Err(Unbindable::OutOfRange { parameters: parameters.told(values), what });
            }
            *place = value;
        }
        parameters.keep(values);
        bound.initial.copy_from_slice(initial);
        bound.system.bind(&all);
        Ok(bound)
    }

    /// Returns the expressions of the equations of motion that may depend on parameters (force balance, constraint
    /// accelerations and velocities, constraint values), see [`SymbolicMechanics::terms`].
    pub fn terms(&self) -> &[Node] {
        self.system.terms()
    }

    /// Returns the derivatives of force balance, constraint accelerations, constraint velocities and constraint
    /// values with respect to the parameters; `None` if the model has no parameters.
    ///
    /// # Errors
    /// If a derivative exceeds the size limits of the graph.
    pub fn slopes(&self) -> Result<Option<Slopes>, ExpressionError> {
        self.parameters.as_ref().map(|(parameters, _)| parameters.slopes()).transpose()
    }

    /// Returns a new evaluator of the mechanical system with its own workspace.
    pub fn problem(&self) -> Box<dyn Mechanical> {
        Box::new(self.system.clone())
    }

    /// Returns the sizes of the mechanical system and its contact laws.
    pub fn structure(&self) -> &MechanicalStructure {
        self.system.structure()
    }

    /// Analyses index, existence and uniqueness according to the theory of mechanical systems with contacts and
    /// joints.
    pub fn analyse(&self) -> Analysis {
        let structure = self.structure();
        let rows = structure.rows();
        let (uniqueness, because) = if rows == 0 {
            (Uniqueness::Unique, "no contacts and no joints: an ordinary differential equation")
        } else if structure.contacts.is_empty() {
            (Uniqueness::Unique, "only joints: a differential-algebraic equation of index 2 on the velocity level")
        } else if structure.slips() == 0 {
            (
                Uniqueness::ExistsNotCertified,
                "contacts without friction: impulses act on velocities, so the index is 2; solutions exist, and are \
                 unique for analytic data (Ballard 2000), not for all smooth ones (Schatzman 1978)",
            )
        } else {
            (
                Uniqueness::ExistsNotCertified,
                "contacts with friction: impulses act on velocities, so the index is 2; solutions exist at the level of \
                 velocities (Stewart 1998) and need not be unique (Painleve 1895)",
            )
        };
        let (index, levels) = if rows == 0 { (0, Vec::new()) } else { (2, vec![0, 0, rows]) };
        Analysis {
            index: Some(f64::from(index)),
            levels,
            uniqueness,
            because: because.to_owned(),
            ..Analysis::default()
        }
    }
}

/// Returns the name of the velocity of a coordinate: `q_dot` for `q`, `q_dot[3]` for `q[3]`.
pub fn velocity_name(coordinate: &str) -> String {
    quantity_name(coordinate, "dot")
}

/// Appends the name of a quantity of a contact, such as `gap`, to the name of the contact, before its index if there
/// is one: the gap of `c[2]` is `c_gap[2]`.
fn quantity_name(of: &str, quantity: &str) -> String {
    match of.split_once('[') {
        Some((vector, index)) => format!("{vector}_{quantity}[{index}"),
        None => format!("{of}_{quantity}"),
    }
}
