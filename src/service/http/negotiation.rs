//! Content negotiation by `Accept` (RFC 9110, section 12.5.1): the most specific media range that matches a format
//! gives its weight, and the format of the greatest weight is chosen.

use axum::http::{HeaderMap, header};

/// The type and the subtype of a media type.
pub type MediaType = (&'static str, &'static str);

/// Returns the format that the client prefers; `offered` lists the formats in the service's order of preference.
pub fn choose<F: Copy>(headers: &HeaderMap, offered: &[(F, MediaType)]) -> Option<F> {
    let lines: Vec<&str> =
        headers.get_all(header::ACCEPT).iter().map(|line| line.to_str().unwrap_or_default()).collect();
    if lines.is_empty() {
        return offered.first().map(|(form, _)| *form);
    }
    let weighed = offered.iter().map(|(form, media_type)| (*form, weight(*media_type, &lines)));
    // The comparison is strict, so that the service's order decides among formats of equal weight.
    let best = weighed.reduce(|best, other| if other.1 > best.1 { other } else { best });
    best.filter(|(_, weight)| *weight > 0.0).map(|(form, _)| form)
}

fn weight((kind, subtype): MediaType, lines: &[&str]) -> f64 {
    let mut found = (0, 0.0);
    for range in lines.iter().flat_map(|line| line.split(',')) {
        let mut parts = range.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default();
        let specificity = match name.split_once('/') {
            Some((a, b)) if a.eq_ignore_ascii_case(kind) && b.eq_ignore_ascii_case(subtype) => 3,
            Some((a, "*")) if a.eq_ignore_ascii_case(kind) => 2,
            Some(("*", "*")) => 1,
            _ => continue,
        };
        let weight = parts
            .find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")))
            .map_or(1.0, |q| q.parse().unwrap_or(0.0));
        if specificity > found.0 {
            found = (specificity, weight);
        }
    }
    found.1
}

#[cfg(test)]
mod tests {
    use super::super::representation::Representation::{self, Csv, Json, Svg};
    use super::*;

    #[track_caller]
    fn assert_chosen(accept: &str, chosen: Option<Representation>) {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        assert_eq!(choose(&headers, Representation::OFFERED), chosen, "{accept}");
    }

    #[test]
    fn json_is_given_to_who_takes_anything() {
        assert_eq!(choose(&HeaderMap::new(), Representation::OFFERED), Some(Json));
        assert_chosen("*/*", Some(Json));
        assert_chosen("text/csv, application/json", Some(Json));
        assert_chosen("application/*", Some(Json));
    }

    #[test]
    fn the_greater_weight_wins() {
        assert_chosen("application/json;q=0.5, text/csv;q=0.8", Some(Csv));
        assert_chosen("Text/CSV", Some(Csv));
        assert_chosen("text/*, application/json; q=0.9", Some(Csv));
        assert_chosen("image/avif, image/*, */*;q=0.8", Some(Svg));
    }

    #[test]
    fn a_specific_range_overrides_a_general_one() {
        assert_chosen("*/*, application/json;q=0", Some(Csv));
        assert_chosen("application/json;q=0.1, */*;q=0.5", Some(Csv));
    }

    #[test]
    fn what_fits_nothing_is_not_acceptable() {
        assert_chosen("image/png", None);
        assert_chosen("application/json;q=0", None);
        assert_chosen("application/json;q=nonsense", None);
        assert_chosen("", None);
    }
}
