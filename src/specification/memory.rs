//! The memory that a solve takes, as far as it is known before it runs: what every run has, its trajectory at the times asked
//! for, and its matrices; of bodies the contacts at the start. What turns out on the way (the fill of sparse factors, contacts that bodies
//! come to, the steps where no times are asked for) is bounded as it does.

use super::checked::Specification;
use super::search::Search;

/// The bytes of a run of one unknown, measured: lists of every kind, the diagnostics and the verdict.
const OF_A_RUN: usize = 6 << 10;

/// The steps of a short run, where the trajectory has no other times: those of a long one turn out on the way.
const FEW_STEPS: usize = 100;

/// Columns of a table beside what is swept and collected.
const OWN_COLUMNS: usize = 8;
/// The bytes of a value of a table, in memory and as text.
const OF_A_VALUE: usize = 24;
/// Those of a sweep of few members: the compiled problem twice, the plan, the summary; measured.
const OF_A_SWEEP: usize = 32 << 10;

impl Specification {
    /// The bytes that a solve is known to take.
    pub fn memory_bytes(&self) -> usize {
        let numbers = self.trajectory_numbers().saturating_add(self.model().numbers(self));
        numbers
            .saturating_mul(size_of::<f64>())
            .saturating_add(self.load.bytes())
            .saturating_add(self.parts() * OF_A_RUN)
            .saturating_add(self.table_bytes())
    }

    /// The table of a sweep, and its JSON, into which it is written.
    fn table_bytes(&self) -> usize {
        let Some(sweep) = self.sweep() else { return 0 };
        let columns = OWN_COLUMNS + sweep.targets.len() + sweep.reducers.names.len();
        sweep.members().saturating_mul(columns).saturating_mul(OF_A_VALUE).saturating_add(OF_A_SWEEP)
    }

    /// A run, and the equations of its derivatives, which are evaluated apart.
    fn parts(&self) -> usize {
        if self.directions() > 0 { 2 } else { 1 }
    }

    /// The directions in which a run is differentiated.
    pub(super) fn directions(&self) -> usize {
        let of_search = self.search().map_or(0, |search| match search {
            Search::Fit(fit) => fit.parameters.len(),
            Search::Branch(_) => self.model().initial().len() + 1,
            Search::Periodic(_) | Search::SteadyState => self.model().initial().len(),
        });
        self.sensitivities().map_or(of_search, |sensitivities| sensitivities.by.len())
    }

    fn trajectory_numbers(&self) -> usize {
        let times = self.output_times().map_or(FEW_STEPS, <[f64]>::len);
        times.saturating_mul(1 + self.output_fields().len())
    }
}
