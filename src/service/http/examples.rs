//! `GET /examples` and `GET /examples/{name}`: specifications that are ready to be posted to `/solve`.

use super::path::Segment;
use super::problem::{Answer, Kind, Problem};
use axum::Json;
use axum::http::{HeaderName, header};
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

macro_rules! examples {
    ($($name:literal)*) => {
        &[$(Example {
            name: $name,
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/", $name, ".json")),
        }),*]
    };
}

/// A specification as it stands in `api/examples`.
#[derive(Debug)]
pub struct Example {
    /// The name of its file, without the extension.
    pub name: &'static str,
    /// The file.
    pub text: &'static str,
}

/// Every file of `api/examples`.
pub const EXAMPLES: &[Example] = examples! {
    "bottleneck"
    "bouncing_ball"
    "buck_converter"
    "coulomb_slope"
    "diode_bridge"
    "diode_bridge_dvi"
    "diode_bridge_filter"
    "diode_bridge_netlist"
    "fluid_queue"
    "friction_belt"
    "friction_disk"
    "hires"
    "newton_cradle"
    "pendulum"
    "pollu"
    "rectifier"
    "relay"
    "reverse_zeno"
    "robertson"
    "rocking_block"
    "rolling_ball"
    "sliding_mode"
    "switching_circle"
    "three_regions"
    "van_der_pol"
    "woodpecker"
};

/// An example in the list.
#[derive(Debug, Serialize, ToSchema)]
pub struct Entry {
    name: &'static str,
    title: String,
    href: String,
}

/// What the list needs of a specification.
#[derive(Deserialize)]
struct Labelled {
    label: Option<String>,
}

impl From<&Example> for Entry {
    fn from(example: &Example) -> Self {
        let label = serde_json::from_str::<Labelled>(example.text).ok().and_then(|labelled| labelled.label);
        let title = label.unwrap_or_else(|| example.name.to_owned());
        Self { name: example.name, title, href: format!("/examples/{}", example.name) }
    }
}

/// List the examples.
#[utoipa::path(get, path = "/examples", tag = "catalogue", responses((status = 200, description = "All examples", body = Vec<Entry>), Problem))]
pub async fn list_examples() -> Json<Vec<Entry>> {
    Json(EXAMPLES.iter().map(Entry::from).collect())
}

/// Fetch an example.
#[utoipa::path(get, path = "/examples/{name}", tag = "catalogue", params(("name" = String, Path, description = "A name from the list")), responses((status = 200, description = "A specification", body = crate::specification::Document), Problem))]
pub async fn find_example(Segment(name): Segment) -> Answer<impl IntoResponse> {
    const JSON: [(HeaderName, &str); 1] = [(header::CONTENT_TYPE, "application/json")];
    let example = EXAMPLES.iter().find(|example| example.name == name);
    example.map(|example| (JSON, example.text)).ok_or_else(|| Problem::plain(Kind::NoSuchExample))
}
