//! The page in a real browser: a headless Chromium, driven as its user would, by keys and by what is on the screen.
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
