//! Keywords that a specification chooses among: the enum, the keywords and their meanings, declared in one place.

/// Declares an enumeration of keywords of a specification; its first variant is the default.
macro_rules! choices {
    ($(#[doc = $about:literal])* $name:ident { $($word:tt $variant:ident: $meaning:tt)* }) => {
        $(#[doc = $about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, utoipa::ToSchema)]
        pub enum $name { $(#[doc = $meaning] #[serde(rename = $word)] $variant,)* }

        impl $name {
            /// All keywords of the enumeration, the default first.
            pub const ALL: &[Self] = &[$(Self::$variant),*];

            /// The keyword, as a specification writes it.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $word,)* }
            }

            /// The meaning of the keyword, in one sentence.
            pub fn meaning(self) -> &'static str {
                match self { $(Self::$variant => $meaning,)* }
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self::ALL[0]
            }
        }
    };
}

pub(super) use choices;
