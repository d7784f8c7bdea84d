//! The inspection of a job store by `dvi store check`: it changes nothing, and refuses a store in use.

use super::JobId;
use super::database::{Database, Rows};
use super::ended::Held;
use super::files::Files;
use super::guarded::guarded;
use super::overlay::Overlay;
use crate::digest::Fingerprint;
use redb::Builder;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::Path;

/// The contents of a job store, and its damage.
#[derive(Debug, Default)]
pub struct Inspection {
    /// The format version of the database of jobs.
    pub format: u64,
    /// The number of jobs whose rows can be read.
    pub jobs: usize,
    /// The number of jobs that have ended, of those whose rows can be read.
    pub ended: usize,
    /// The number of ended jobs whose results are intact.
    pub results: usize,
    /// The total size of the intact results, in bytes.
    pub result_bytes: usize,
    /// The stored parts of each job that are damaged or missing.
    pub damaged: BTreeMap<JobId, Vec<&'static str>>,
    /// The jobs whose rows another version of the program wrote.
    pub unreadable: Vec<JobId>,
    /// The jobs whose rows were lost when the database was rebuilt.
    pub lost: Vec<JobId>,
    /// The number of result files whose job has no row.
    pub orphaned: usize,
    /// Whether the pages of the database are intact.
    pub is_sound: bool,
}

impl Inspection {
    /// Inspects the job store in `folder`.
    ///
    /// # Errors
    /// The store is absent, in use or of a later version, or its database cannot be opened.
    pub fn of(folder: &Path) -> io::Result<Self> {
        let overlay = Overlay::open(&folder.join("jobs.redb"))?;
        let files = Files::at(folder.join("results"));
        let open = move || guarded(|| Ok(Builder::new().create_with_backend(overlay.clone())?));
        let (database, format) = Database::open(open, &|id| files.look(id))?;
        let Some(format) = format else {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "jobs.redb is empty"));
        };
        let is_sound = database.is_sound();
        let Rows { records, unreadable, damaged, lost, .. } = database.records();
        let mut found = Self { format, is_sound, unreadable, lost, jobs: records.len(), ..Self::default() };
        for id in damaged {
            found.damages(id, "row");
        }
        let aside = found.unreadable.iter().chain(&found.lost).chain(found.damaged.keys());
        let mut known: BTreeSet<JobId> = aside.copied().collect();
        for (id, record) in records {
            known.insert(id);
            let document = database.document(id).ok().flatten();
            if document.zip(record.document).is_none_or(|(document, digest)| digest.vouch(document).is_err()) {
                found.damages(id, "specification");
            }
            let Some(ended) = record.ended else { continue };
            found.ended += 1;
            let vouched = |text: Option<Vec<u8>>, json: Fingerprint| {
                text.is_some_and(|text| json.digest.vouch(text).is_ok()).then_some(json.bytes)
            };
            let bytes = match ended.held {
                None | Some(Held::Memory(_)) => continue,
                Some(Held::Table(json)) => vouched(database.results(id).ok().flatten(), json),
                Some(Held::File(json)) => vouched(files.find(id).ok().flatten(), json),
                Some(Held::Columns { json, index }) => {
                    files.columns(id, json, index).verify().is_ok().then_some(json.bytes)
                }
            };
            if let Some(bytes) = bytes {
                found.results += 1;
                found.result_bytes += bytes;
            } else {
                found.damages(id, "results");
            }
        }
        // Jobs whose ids are only in other tables than that of the rows have lost their rows: a page of the tree
        // above the row cannot be read.
        for id in database.names().difference(&known) {
            found.damages(*id, "row");
        }
        found.orphaned = files.names()?.difference(&known).count();
        Ok(found)
    }

    /// Whether no part of the job store is damaged.
    pub fn is_whole(&self) -> bool {
        self.is_sound && self.damaged.is_empty()
    }

    fn damages(&mut self, id: JobId, what: &'static str) {
        self.damaged.entry(id).or_default().push(what);
    }
}
