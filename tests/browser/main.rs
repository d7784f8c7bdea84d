//! The page in a real browser: a headless Chromium, driven by keys and checked by what the screen shows.
//!
//! Needs Debian's package `chromium`; `DVI_CHROMIUM` names another program.

mod accessibility;
mod comparing;
mod driver;
mod editing;
mod guide;
mod live;
mod looks;
mod maps;
mod numbers;
mod pictures;
mod places;
mod prefix;
mod server;
mod solving;
mod studies;
mod verdict;
