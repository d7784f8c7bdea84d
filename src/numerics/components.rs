//! Strongly connected components of a directed graph.

/// The visiting index that marks a node of the graph as not yet visited.
const UNSEEN: usize = usize::MAX;

/// Returns the strongly connected components of the graph with an edge from each node `k` to the nodes in `edges[k]`
/// (Tarjan 1972, *Depth-first search and linear graph algorithms*, without recursion). Each component comes after
/// those that its edges lead to; its nodes are in increasing order.
pub fn components(edges: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut found = Vec::new();
    let mut index = vec![UNSEEN; edges.len()];
    let mut low = index.clone();
    let mut is_open = vec![false; edges.len()];
    let (mut count, mut open) = (0, Vec::new());
    for root in 0..edges.len() {
        // A path from the root of the depth-first search: nodes, each with the number of its edges already followed.
        let mut path = if index[root] == UNSEEN { vec![(root, 0)] } else { Vec::new() };
        while let Some((node, followed)) = path.pop() {
            if followed == 0 {
                (index[node], low[node], is_open[node]) = (count, count, true);
                open.push(node);
                count += 1;
            } else {
                low[node] = low[node].min(low[edges[node][followed - 1]]);
            }
            let rest = edges[node].iter().enumerate().skip(followed);
            let mut next = None;
            for (place, &to) in rest {
                if index[to] == UNSEEN {
                    next = Some((place + 1, to));
                    break;
                }
                if is_open[to] {
                    low[node] = low[node].min(index[to]);
                }
            }
            if let Some((followed, to)) = next {
                path.extend([(node, followed), (to, 0)]);
            } else if low[node] == index[node] {
                let first = open.iter().rposition(|&other| other == node).unwrap_or_default();
                let mut component = open.split_off(first);
                component.iter().for_each(|&member| (is_open[member], low[member]) = (false, UNSEEN));
                component.sort_unstable();
                found.push(component);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::components;

    #[test]
    fn each_component_comes_after_those_that_it_leads_to() {
        // The graph of Tarjan's paper: 1 2 3 4 5 6 7 8 with components {1, 2, 3, 4, 5, 6, 7}, and 8 alone.
        let edges = [vec![1], vec![2, 7], vec![3, 6], vec![4], vec![1, 5], vec![0, 2], vec![3, 5], vec![]];
        assert_eq!(components(&edges), [vec![7], (0..7).collect()]);
        assert_eq!(components(&[vec![1, 1], vec![2], vec![1], vec![0, 3]]), [vec![1, 2], vec![0], vec![3]]);
        assert_eq!(components(&[]), Vec::<Vec<usize>>::new());
    }

    #[test]
    fn components_are_the_nodes_that_reach_each_other() {
        // Compares with reachability by the transitive closure, on random graphs of all sizes up to nine.
        let mut random = 1_u64;
        for round in 0..2000 {
            let n = 1 + round % 9;
            let mut draw = || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (random >> 33).is_multiple_of(5)
            };
            let edges: Vec<Vec<usize>> = (0..n).map(|_| (0..n).filter(|_| draw()).collect()).collect();
            let mut reaches = vec![vec![false; n]; n];
            for (from, to) in edges.iter().enumerate() {
                reaches[from][from] = true;
                to.iter().for_each(|&to| reaches[from][to] = true);
            }
            for middle in 0..n {
                for from in 0..n {
                    for to in 0..n {
                        reaches[from][to] |= reaches[from][middle] && reaches[middle][to];
                    }
                }
            }
            let found = components(&edges);
            let mut all: Vec<usize> = found.concat();
            for (place, component) in found.iter().enumerate() {
                for &a in component {
                    assert!((0..n).all(|b| component.contains(&b) == (reaches[a][b] && reaches[b][a])), "{edges:?}");
                    let later = found[place + 1..].concat();
                    assert!(later.iter().all(|&b| !reaches[a][b]), "{edges:?}");
                }
            }
            all.sort_unstable();
            assert_eq!(all, (0..n).collect::<Vec<_>>());
        }
    }
}
