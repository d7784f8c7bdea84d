//! The list of jobs at `/jobs`.

use crate::harness::{Call, DECAY, Gate, Reply, Site, instant, one_worker};
use crate::nats::on_both;
use axum::http::StatusCode;

on_both! {
    jobs_are_listed_newest_first_to_their_own_client,
    pages_follow_each_other_without_gap_or_overlap,
    jobs_are_found_by_their_status,
}

async fn labelled(site: &Site, client: u8, label: &str) -> String {
    let document = DECAY.replacen('{', &format!("{{\"label\":\"{label}\","), 1);
    let reply = Call::solve(document).client(client).header("prefer", "respond-async").send(site).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED);
    reply.header("location").to_owned()
}

async fn list(site: &Site, client: u8, query: &str) -> Reply {
    let reply = Call::new("GET", &format!("/jobs{query}")).client(client).send(site).await;
    assert_eq!(reply.status, StatusCode::OK, "{query}: {reply:?}");
    assert_eq!(reply.header("cache-control"), "no-store");
    reply
}

/// Returns the paths of the jobs on a page of the list.
fn paths(reply: &Reply) -> Vec<String> {
    let page = reply.json();
    page["jobs"].as_array().unwrap().iter().map(|job| format!("/jobs/{}", job["id"].as_str().unwrap())).collect()
}

async fn jobs_are_listed_newest_first_to_their_own_client() {
    let site = Site::new(one_worker(), instant());
    let mut mine = Vec::new();
    for k in 0..5 {
        mine.push(labelled(&site, 1, &k.to_string()).await);
        labelled(&site, 2, "other").await;
    }
    mine.reverse();
    assert_eq!(paths(&list(&site, 1, "").await), mine);
    assert!(paths(&list(&site, 3, "").await).is_empty());
}

async fn pages_follow_each_other_without_gap_or_overlap() {
    let site = Site::new(one_worker(), instant());
    for k in 0..7 {
        labelled(&site, 1, if k % 3 == 0 { "a b&c" } else { "x" }).await;
    }
    let all = paths(&list(&site, 1, "").await);
    let mut found = Vec::new();
    let mut query = "?limit=3".to_owned();
    let mut sizes = Vec::new();
    loop {
        let page = list(&site, 1, &query).await;
        sizes.push(paths(&page).len());
        found.extend(paths(&page));
        let Some(link) = page.headers.get("link") else { break };
        let (next, relation) = link.to_str().unwrap().split_once('>').unwrap();
        assert_eq!(relation, "; rel=\"next\"");
        query = next.strip_prefix("</jobs").unwrap().to_owned();
        labelled(&site, 1, "newer than the first page").await;
    }
    assert_eq!((found, sizes), (all, vec![3, 3, 1]));
    let first = list(&site, 1, "?limit=2&label=a+b%26c").await;
    let next = first.header("link").split_once("</jobs").unwrap().1.split_once('>').unwrap().0.to_owned();
    let second = list(&site, 1, &next).await;
    assert_eq!((paths(&first).len(), paths(&second).len(), second.headers.contains_key("link")), (2, 1, false));
}

async fn jobs_are_found_by_their_status() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let (running, waiting) = (labelled(&site, 1, "r").await, labelled(&site, 1, "w").await);
    gate.entered(1).await;
    assert_eq!(paths(&list(&site, 1, "?status=running").await), [running.as_str()]);
    assert_eq!(paths(&list(&site, 1, "?status=accepted").await), [waiting.as_str()]);
    Call::new("POST", &format!("{waiting}/cancel")).client(1).send(&site).await;
    gate.let_through(1);
    site.ended(&running).await;
    assert_eq!(paths(&list(&site, 1, "?status=dismissed").await), [waiting]);
    assert_eq!(paths(&list(&site, 1, "?status=successful&limit=1").await), [running]);
}

#[tokio::test]
async fn a_list_that_makes_no_sense_is_refused() {
    let site = Site::new(one_worker(), instant());
    for query in ["limit=0", "limit=1001", "limit=-1", "status=done", "cursor=1;2", "page=2", "limit=1&limit=2"] {
        site.get(&format!("/jobs?{query}")).await.problem(400, "bad-query");
    }
}
