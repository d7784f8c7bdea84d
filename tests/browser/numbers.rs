//! The format of the numbers in plots and tables of the web page.

use crate::driver::Page;
use serde_json::json;

#[test]
fn ticks_have_the_digits_of_their_step() {
    let page = Page::open("ticks", "/");
    let ticks = "import('/page/numbers.js').then(({ticks}) => [[-0.5, -0.25, 0], [0, 0.1, 0.2, 0.30000000000000004],
        [0, 2.5e-5, 5e-5], [1e6, 1.5e6], [100, 150], [1.00001, 1.00002], [3], []].map((at) => ticks(at).join(' ')))";
    let told =
        ["-0.50 -0.25 0", "0 0.1 0.2 0.3", "0 25e-6 50e-6", "1.0e6 1.5e6", "100 150", "1.00001 1.00002", "3", ""];
    assert_eq!(page.value(ticks), json!(told));
}

#[test]
fn a_number_has_a_power_of_ten_only_where_it_needs_one() {
    let page = Page::open("numbers", "/");
    let numbers =
        "import('/page/numbers.js').then(({number, seconds}) => [...[0, 8173, 0.1, -3.14159265, 123456.7, 1.5e-7,
        1e300, null].map((value) => number(value)), seconds(0.00123), seconds(2)])";
    let told = ["0", "8\u{202f}173", "0.1", "-3.1416", "1.2346e5", "1.5e-7", "1e300", "–", "1.23 ms", "2 s"];
    assert_eq!(page.value(numbers), json!(told));
}
