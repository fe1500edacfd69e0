//! Reading pytest's report.

use super::tally::{Skip, Tally};

/// Counts the test cases of a JUnit XML file.
pub(super) fn read(xml: &str) -> Result<Tally, String> {
    let document = roxmltree::Document::parse(xml).map_err(|e| format!("pytest's report is no XML: {e}"))?;
    let mut tally = Tally::default();
    for case in document.descendants().filter(|node| node.has_tag_name("testcase")) {
        let name = format!(
            "{}::{}",
            case.attribute("classname").unwrap_or_default(),
            case.attribute("name").unwrap_or_default()
        );
        let child_named = |tag: &str| case.children().find(|child_named| child_named.has_tag_name(tag));
        if let Some(fault) = child_named("failure").or_else(|| child_named("error")) {
            let message = fault.attribute("message").unwrap_or_default().lines().next().unwrap_or_default();
            tally.failures.push(format!("{name}: {message}"));
        } else if let Some(skip) = child_named("skipped") {
            let reason = skip.attribute("message").unwrap_or("no reason given").to_owned();
            tally.skips.push(Skip { name, reason });
        } else {
            tally.passed += 1;
        }
    }
    Ok(tally)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_each_kind() {
        let tally = read(
            "<?xml version=\"1.0\"?><testsuites><testsuite tests=\"4\">\
             <testcase classname=\"a\" name=\"passes\"/>\
             <testcase classname=\"a\" name=\"fails\"><failure message=\"1 != 2&#10;more\">trace</failure></testcase>\
             <testcase classname=\"a\" name=\"breaks\"><error message=\"no fixture\"/></testcase>\
             <testcase classname=\"a\" name=\"waits\"><skipped message=\"needs real-gpu: none\"/></testcase>\
             </testsuite></testsuites>",
        )
        .unwrap();
        assert_eq!(tally.to_string(), "1 passed, 2 failed, 1 skipped");
        assert_eq!(tally.failures[0], "a::fails: 1 != 2");
        assert_eq!(tally.skips[0].reason, "needs real-gpu: none");
        assert!(read("not xml").is_err());
    }
}
