//! `GET /`: the web page of the service. Its files are compiled into the program and need neither a build step nor
//! the network.
//!
//! The content security policy lets the page run only scripts and styles of this service, none of them inline, and
//! connect to no other host, so that text in a label or a message can never become code. Plots are drawn by uPlot,
//! bodies in space by three.js, which is fetched only when needed, and the editor is `CodeMirror` (all in `vendor/`;
//! the latter two are made by `vendor/bundle`).

use super::context::address;
use super::http::{Kind, Problem};
use axum::Router;
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write as _;
use std::sync::{LazyLock, OnceLock};

/// The content security policy of the page: what the browser may load, run and connect to.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A file of the web page, compiled into the program.
struct File {
    name: &'static str,
    media_type: &'static str,
    text: &'static str,
    /// The text compressed by `gzip` at its best level, on first request: a fifth smaller than at the fast level used
    /// for other responses.
    compressed: OnceLock<Vec<u8>>,
}

macro_rules! files {
    ($($name:literal: $media_type:literal;)*) => {
        LazyLock::new(|| vec![$(File { name: $name, media_type: $media_type, text: include_str!($name), compressed: OnceLock::new() }),*])
    };
}

const INDEX: &str = "index.html";

static FILES: LazyLock<Vec<File>> = files! {
    "icon.svg": "image/svg+xml";
    "index.html": "text/html; charset=utf-8";
    "page.css": "text/css; charset=utf-8";
    "page.js": "text/javascript; charset=utf-8";
    "claims.js": "text/javascript; charset=utf-8";
    "clock.js": "text/javascript; charset=utf-8";
    "colours.js": "text/javascript; charset=utf-8";
    "comparison.js": "text/javascript; charset=utf-8";
    "editor.js": "text/javascript; charset=utf-8";
    "element.js": "text/javascript; charset=utf-8";
    "events.js": "text/javascript; charset=utf-8";
    "evidence.js": "text/javascript; charset=utf-8";
    "expressions.js": "text/javascript; charset=utf-8";
    "fields.js": "text/javascript; charset=utf-8";
    "figure.js": "text/javascript; charset=utf-8";
    "fixes.js": "text/javascript; charset=utf-8";
    "gallery.js": "text/javascript; charset=utf-8";
    "hairlines.js": "text/javascript; charset=utf-8";
    "heatmap.js": "text/javascript; charset=utf-8";
    "jobs.js": "text/javascript; charset=utf-8";
    "knobs.js": "text/javascript; charset=utf-8";
    "language.js": "text/javascript; charset=utf-8";
    "live.js": "text/javascript; charset=utf-8";
    "movie.js": "text/javascript; charset=utf-8";
    "numbers.js": "text/javascript; charset=utf-8";
    "places.js": "text/javascript; charset=utf-8";
    "plots.js": "text/javascript; charset=utf-8";
    "previews.js": "text/javascript; charset=utf-8";
    "service.js": "text/javascript; charset=utf-8";
    "share.js": "text/javascript; charset=utf-8";
    "stage.js": "text/javascript; charset=utf-8";
    "standalone.js": "text/javascript; charset=utf-8";
    "study.js": "text/javascript; charset=utf-8";
    "unknown.js": "text/javascript; charset=utf-8";
    "verdict.js": "text/javascript; charset=utf-8";
    "pictures/film.js": "text/javascript; charset=utf-8";
    "pictures/kinds.js": "text/javascript; charset=utf-8";
    "pictures/circuit.js": "text/javascript; charset=utf-8";
    "pictures/hull.js": "text/javascript; charset=utf-8";
    "pictures/index.js": "text/javascript; charset=utf-8";
    "pictures/pace.js": "text/javascript; charset=utf-8";
    "pictures/phase.js": "text/javascript; charset=utf-8";
    "pictures/plane.js": "text/javascript; charset=utf-8";
    "pictures/profile.js": "text/javascript; charset=utf-8";
    "pictures/scene.js": "text/javascript; charset=utf-8";
    "pictures/shapes.js": "text/javascript; charset=utf-8";
    "pictures/surface.js": "text/javascript; charset=utf-8";
    "vendor/codemirror.js": "text/javascript; charset=utf-8";
    "vendor/three.js": "text/javascript; charset=utf-8";
    "vendor/uplot.css": "text/css; charset=utf-8";
    "vendor/uplot.js": "text/javascript; charset=utf-8";
};

/// Returns the routes of the page at `/` and of its files under `/page/`.
pub fn routes<S: Clone + Send + Sync + 'static>(prefix: &str) -> Router<S> {
    let index = || get(async |headers: HeaderMap| find_file(INDEX, &headers));
    let router = Router::new().route("/", index());
    let router = if prefix.is_empty() { router } else { router.route(&format!("{prefix}/"), index()) };
    router.route("/page/{*name}", get(async |Path(name): Path<String>, headers: HeaderMap| find_file(&name, &headers)))
}

/// Returns the file with this name, or status 304 if the browser has it already.
fn find_file(name: &str, headers: &HeaderMap) -> Response {
    let Some(file) = FILES.iter().find(|file| file.name == name) else {
        return Problem::plain(Kind::NotFound).into_response();
    };
    let tag = file.tag();
    let known = headers.get(header::IF_NONE_MATCH).is_some_and(|value| Some(value) == tag.as_ref());
    let text = || match address("/") {
        root if name == INDEX => file.text.replace("=\"/", &format!("=\"{root}")).into_response(),
        _ if takes_gzip(headers) => ([(header::CONTENT_ENCODING, "gzip")], file.compressed()).into_response(),
        _ => file.text.into_response(),
    };
    let mut response = if known { StatusCode::NOT_MODIFIED.into_response() } else { text() };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(file.media_type));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
    headers.extend(tag.map(|tag| (header::ETAG, tag)));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    response
}

/// Whether the client accepts `gzip` encoding (RFC 9110, section 12.5.3).
fn takes_gzip(headers: &HeaderMap) -> bool {
    let lines = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|line| line.to_str().ok());
    lines.flat_map(|line| line.split(',')).any(|coding| {
        let (name, weight) = coding.split_once(';').unwrap_or((coding, ""));
        let weight = weight.trim().strip_prefix("q=").map_or(1.0, |weight| weight.parse().unwrap_or(0.0));
        name.trim().eq_ignore_ascii_case("gzip") && weight > 0.0
    })
}

impl File {
    fn compressed(&'static self) -> &'static [u8] {
        self.compressed.get_or_init(|| {
            let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
            // Writing compressed bytes to memory cannot fail.
            let _ = encoder.write_all(self.text.as_bytes());
            encoder.finish().unwrap_or_default()
        })
    }

    /// Returns the entity tag of the file, a hash of its text, so that a changed file gets a different tag.
    fn tag(&self) -> Option<HeaderValue> {
        let mut hasher = DefaultHasher::new();
        self.text.hash(&mut hasher);
        HeaderValue::try_from(format!("\"{:016x}\"", hasher.finish())).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read as _;

    fn get(name: &str, known: Option<HeaderValue>) -> Response {
        find_file(name, &known.into_iter().map(|tag| (header::IF_NONE_MATCH, tag)).collect())
    }

    #[test]
    fn every_file_is_given_under_the_policy() {
        for file in FILES.iter() {
            let response = get(file.name, None);
            assert_eq!(response.status(), StatusCode::OK, "{}", file.name);
            assert_eq!(response.headers()[header::CONTENT_SECURITY_POLICY], POLICY);
            assert_eq!(response.headers()[header::CONTENT_TYPE], file.media_type);
        }
        assert_eq!(get("../mod.rs", None).status(), StatusCode::NOT_FOUND);
    }

    #[test]
    fn files_are_compressed_for_who_takes_them_so() {
        let with = |codings: &'static str| {
            find_file("page.js", &HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(codings))]))
        };
        assert_eq!(with("br, GZIP;q=0.5").headers()[header::CONTENT_ENCODING], "gzip");
        for codings in ["br", "gzip;q=0", "gzipped"] {
            assert!(!with(codings).headers().contains_key(header::CONTENT_ENCODING), "{codings}");
        }
        let file = FILES.iter().find(|file| file.name == "page.js").unwrap();
        let mut text = String::new();
        flate2::read::GzDecoder::new(file.compressed()).read_to_string(&mut text).unwrap();
        assert_eq!(text, file.text);
    }

    #[test]
    fn a_file_the_browser_has_is_not_sent_again() {
        let tag = get(INDEX, None).headers()[header::ETAG].clone();
        assert_eq!(get(INDEX, Some(tag.clone())).status(), StatusCode::NOT_MODIFIED);
        assert_eq!(get("page.js", Some(tag)).status(), StatusCode::OK);
    }

    #[test]
    fn what_the_files_name_is_there_and_nothing_is_inline() {
        let own = FILES.iter().filter(|file| !file.name.starts_with("vendor/"));
        for file in own {
            for address in file.text.split(['"', '\'']).filter_map(|piece| piece.strip_prefix("/page/")) {
                assert!(FILES.iter().any(|file| file.name == address), "{}: {address}", file.name);
            }
            let folder = file.name.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
            for module in file.text.split('"').filter(|piece| piece.starts_with("./") || piece.starts_with("../")) {
                let name = match module.strip_prefix("../") {
                    Some(above) => above.to_owned(),
                    None => format!("{folder}{}", &module[2..]),
                };
                assert!(name.is_empty() || FILES.iter().any(|file| file.name == name), "{}: {module}", file.name);
            }
            // `standalone.js` contains the source of a separate HTML file, to which the content security policy does
            // not apply.
            if file.name == "standalone.js" {
                continue;
            }
            for inline in ["style=", "onclick=", "<style", "javascript:", "innerHTML", "http://", "https://"] {
                // Links to public discussion threads are allowed, since the policy lets nothing be loaded from them.
                let shown = file.text.replace("http://www.w3.org/2000/svg", "").replace("\"https://github.com/", "\"");
                assert!(!shown.contains(inline), "{}: {inline}", file.name);
            }
        }
    }
}
