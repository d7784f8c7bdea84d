//! Islands: contacts and joints that share moving bodies, directly or through others, form one problem. Islands are
//! solved separately, and in parallel if they are large enough.

use std::num::NonZero;
use std::thread;

/// Disjoint sets of bodies (Tarjan 1975, *Efficiency of a good but not linear set union algorithm*), and the links
/// (contacts and joints) of each set.
#[derive(Clone, Debug, Default)]
pub struct Islands {
    parent: Vec<u32>,
    /// Indices of links, grouped by island and ascending within each; `offsets` holds the start of each island in
    /// `links`.
    links: Vec<u32>,
    offsets: Vec<usize>,
    island_of_root: Vec<u32>,
    counts: Vec<usize>,
}

impl Islands {
    /// Groups links between bodies into islands; a link has one or two moving bodies. Islands are numbered by their
    /// first link.
    pub fn group(&mut self, bodies: usize, links: impl Iterator<Item = (usize, Option<usize>)> + Clone) {
        self.parent.clear();
        self.parent.extend(0..bodies as u32);
        for (a, b) in links.clone() {
            if let Some(b) = b {
                let (a, b) = (self.root(a), self.root(b));
                self.parent[a.max(b)] = a.min(b) as u32;
            }
        }
        const NONE: u32 = u32::MAX;
        self.island_of_root.clear();
        self.island_of_root.resize(bodies, NONE);
        self.counts.clear();
        for (a, _) in links.clone() {
            let root = self.root(a);
            if self.island_of_root[root] == NONE {
                self.island_of_root[root] = self.counts.len() as u32;
                self.counts.push(0);
            }
            self.counts[self.island_of_root[root] as usize] += 1;
        }
        self.offsets.clear();
        self.offsets.push(0);
        for count in &mut self.counts {
            let start = self.offsets.last().copied().unwrap_or(0);
            self.offsets.push(start + *count);
            *count = start;
        }
        self.links.clear();
        self.links.resize(self.offsets.last().copied().unwrap_or(0), 0);
        for (k, (a, _)) in links.enumerate() {
            let root = self.root(a);
            let next = &mut self.counts[self.island_of_root[root] as usize];
            self.links[*next] = k as u32;
            *next += 1;
        }
    }

    /// Returns the number of islands that have links (contacts or joints).
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Whether no island has links (contacts or joints).
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the indices of the links (contacts and joints) of an island.
    pub fn links(&self, island: usize) -> &[u32] {
        &self.links[self.offsets[island]..self.offsets[island + 1]]
    }

    fn root(&mut self, body: usize) -> usize {
        let mut body = body;
        while self.parent[body] as usize != body {
            // Path halving: every second node of the path is linked to its grandparent.
            self.parent[body] = self.parent[self.parent[body] as usize];
            body = self.parent[body] as usize;
        }
        body
    }
}

/// Runs `work` on every task, each with exclusive use of a workspace: on one thread per workspace, or on the current
/// thread if all tasks but the largest together weigh less than `worth`. The result of a task must not depend on its
/// workspace.
pub fn solve_apart<T: Send, W: Send>(
    tasks: &mut [T],
    workspaces: &mut [W],
    weight: impl Fn(&T) -> usize,
    worth: usize,
    work: impl Fn(&mut T, &mut W) + Sync,
) {
    let total: usize = tasks.iter().map(&weight).sum();
    let largest = tasks.iter().map(&weight).max().unwrap_or(0);
    if workspaces.len() < 2 || total - largest < worth {
        if let [workspace, ..] = workspaces {
            tasks.iter_mut().for_each(|task| work(task, workspace));
        }
        return;
    }
    // Assign the tasks (islands to solve) to threads, the heaviest first, each to the thread with the least load so
    // far.
    let mut order: Vec<&mut T> = tasks.iter_mut().collect();
    order.sort_by_key(|task| std::cmp::Reverse(weight(task)));
    let mut shares: Vec<(usize, Vec<&mut T>)> = workspaces.iter().map(|_| (0, Vec::new())).collect();
    for task in order {
        if let Some(share) = shares.iter_mut().min_by_key(|share| share.0) {
            share.0 += weight(task);
            share.1.push(task);
        }
    }
    let work = &work;
    thread::scope(|scope| {
        for ((_, share), workspace) in shares.into_iter().zip(workspaces) {
            scope.spawn(move || share.into_iter().for_each(|task| work(task, workspace)));
        }
    });
}

/// Returns the number of threads of one solve: the available parallelism of the machine, at most four.
pub fn threads() -> usize {
    thread::available_parallelism().map_or(1, NonZero::get).min(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_that_share_a_moving_body_make_one_island() {
        let links = [(0, Some(1)), (2, None), (3, Some(4)), (1, Some(5)), (4, None), (6, None)];
        let mut islands = Islands::default();
        islands.group(8, links.iter().copied());
        let found: Vec<_> = (0..islands.len()).map(|k| islands.links(k).to_vec()).collect();
        assert_eq!(found, [vec![0, 3], vec![1], vec![2, 4], vec![5]]);
    }

    #[test]
    fn a_long_chain_is_one_island_from_either_end() {
        let mut islands = Islands::default();
        let n = 20_000;
        islands.group(n, (0..n - 1).map(|k| (k, Some(k + 1))));
        assert_eq!((islands.len(), islands.links(0).len()), (1, n - 1));
        islands.group(n, (0..n - 1).rev().map(|k| (k + 1, Some(k))));
        assert_eq!((islands.len(), islands.links(0).len()), (1, n - 1));
    }

    #[test]
    fn every_task_is_worked_once_on_any_number_of_threads() {
        for threads in [1, 2, 3] {
            let mut tasks: Vec<(usize, usize)> = (0..17).map(|k| (k, 0)).collect();
            let mut workspaces = vec![0_usize; threads];
            solve_apart(
                &mut tasks,
                &mut workspaces,
                |task| task.0,
                10,
                |task, done| {
                    task.1 += task.0 * task.0;
                    *done += 1;
                },
            );
            assert!(tasks.iter().all(|&(k, square)| square == k * k));
            assert_eq!(workspaces.iter().sum::<usize>(), 17);
            assert!(workspaces.iter().all(|&done| done > 0));
        }
    }
}
