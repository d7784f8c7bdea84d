//! The part of the results that a query selects: `?fields=x,i(R1,a)&from=0.5&to=2&every=10`.

use super::problem::Problem;
use super::query::Query;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use solution::Excerpt;

/// The excerpt of the results that a query selects; `None` for the whole results.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcerptQuery(pub Option<Excerpt>);

impl<S: Send + Sync> FromRequestParts<S> for ExcerptQuery {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Self::Rejection> {
        let Ok(mut query) = Query::from_request_parts(parts, state).await;
        let whole = Excerpt::default();
        let asked = Excerpt {
            fields: query.text("fields").map(|list| names(&list)),
            from: query.number("from").unwrap_or(whole.from),
            to: query.number("to").unwrap_or(whole.to),
            every: query.value("every", "a whole number from one").unwrap_or(whole.every),
        };
        query.end()?;
        Ok(Self((asked != whole).then_some(asked)))
    }
}

/// Splits a list of field names at commas; a comma within parentheses is part of a name.
fn names(list: &str) -> Vec<String> {
    let mut depth = 0_usize;
    let parts = list.split(|c| {
        match c {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        c == ',' && depth == 0
    });
    parts.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::Request;
    use std::num::NonZeroUsize;

    async fn asked(address: &str) -> Result<Option<Excerpt>, String> {
        let (mut parts, ()) = Request::builder().uri(address).body(()).unwrap().into_parts();
        let asked = ExcerptQuery::from_request_parts(&mut parts, &()).await;
        asked.map(|asked| asked.0).map_err(|problem| serde_json::to_value(problem).unwrap()["detail"].to_string())
    }

    #[tokio::test]
    async fn what_asks_for_no_less_is_the_whole() {
        assert_eq!(asked("/r").await, Ok(None));
        assert_eq!(asked("/r?every=1").await, Ok(None));
    }

    #[tokio::test]
    async fn every_parameter_is_read() {
        let part = asked("/r?fields=x,%20i(R1,a)%2Cv&from=-1e-3&to=2&every=10").await.unwrap().unwrap();
        assert_eq!(part.fields.unwrap(), ["x", "i(R1,a)", "v"]);
        assert_eq!((part.from, part.to, part.every), (-1e-3, 2.0, NonZeroUsize::new(10).unwrap()));
    }

    #[tokio::test]
    async fn all_that_is_wrong_is_told_at_once() {
        let wrong = asked("/r?from=soon&to=inf&every=0&form=csv&to=3").await.unwrap_err();
        for told in [
            "from is a finite number",
            "to is a finite number",
            "every is a whole",
            "form is not a parameter",
            "to is repeated",
        ] {
            assert!(wrong.contains(told), "{told} in {wrong}");
        }
    }
}
