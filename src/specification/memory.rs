//! Memory footprint of a solve, as far as it is known before the run: the fixed costs of a run, its trajectory at the
//! requested times, and its matrices; for rigid bodies, also the contacts at the start. The fill of sparse factors,
//! later contacts, and steps reported without requested times are only known during the run, and are limited then.

use super::checked::Specification;
use super::search::Search;
use radau::MOST_STAGES;

/// Measured memory of a run with one unknown, in bytes: all kinds of lists, the diagnostics and the verdict.
const OF_A_RUN: usize = 6 << 10;

/// Number of steps assumed for a trajectory without output times, and for the backward integration of the adjoint
/// equations; the number of steps of a long run is only known during the run.
const FEW_STEPS: usize = 100;

/// Number of columns in the table of a sweep besides swept and collected values.
const OWN_COLUMNS: usize = 8;
/// Bytes per value in the table of a sweep; the summary of the table is computed from these values.
const OF_A_VALUE: usize = 8;
/// Measured memory of a sweep of few members, in bytes: the compiled problem twice, the plan and the summary.
const OF_A_SWEEP: usize = 32 << 10;

impl Specification {
    /// Returns a lower estimate of the memory of a solve, in bytes.
    pub fn memory_bytes(&self) -> usize {
        let runs = self.model().runs(self);
        let numbers = self.trajectory_numbers().saturating_add(self.model().numbers(self).saturating_mul(runs));
        let numbers = numbers.saturating_add(self.stored_numbers());
        numbers
            .saturating_mul(size_of::<f64>())
            .saturating_add(self.load.bytes().saturating_mul(runs))
            .saturating_add(self.parts() * OF_A_RUN)
            .saturating_add(self.table_bytes())
    }

    /// Returns the memory of the table of a sweep, or of the part of the sweep to be solved, in bytes.
    fn table_bytes(&self) -> usize {
        let Some(sweep) = self.sweep() else { return 0 };
        let columns = OWN_COLUMNS + sweep.targets.len() + sweep.reducers.names.len() + sweep.numbers_kept();
        sweep.chunk().members.len().saturating_mul(columns).saturating_mul(OF_A_VALUE).saturating_add(OF_A_SWEEP)
    }

    /// Number of runs in memory at once; the sensitivity equations of a run count as one more run.
    fn parts(&self) -> usize {
        self.model().runs(self) + usize::from(self.directions() > 0)
    }

    /// Number of directions (parameters or initial values) in which a run is differentiated.
    pub(super) fn directions(&self) -> usize {
        let of_search = self.search().map_or(0, |search| match search {
            Search::Fit(fit) => fit.parameters.len(),
            Search::Branch(_) => self.model().initial().len() + 1,
            Search::Periodic(..) | Search::SteadyState => self.model().initial().len(),
        });
        let basis = if self.is_adjoint() { self.model().initial().len() } else { 0 };
        self.sensitivities().map_or(of_search, |sensitivities| sensitivities.by.len() + basis)
    }

    fn is_adjoint(&self) -> bool {
        self.sensitivities().is_some_and(|sensitivities| sensitivities.objective.is_some())
    }

    /// Number of values that adjoint mode stores: unknowns at the beginning and at the stages of each step.
    fn stored_numbers(&self) -> usize {
        let sizes = self.model().sizes();
        let of_step = (sizes.states + sizes.variables).saturating_mul(1 + MOST_STAGES);
        if self.is_adjoint() { of_step.saturating_mul(FEW_STEPS) } else { 0 }
    }

    /// Number of values of a stored trajectory; 0 for a sweep, whose members store no steps unless asked to.
    fn trajectory_numbers(&self) -> usize {
        if self.sweep().is_some() {
            return 0;
        }
        let times = self.output_times().map_or(FEW_STEPS, <[f64]>::len);
        times.saturating_mul(1 + self.output_fields().len())
    }
}
