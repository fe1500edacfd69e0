//! Removes personal data from texts of a report: the user's folders, the user's name and the machine's name.

/// Longest names that are common words as well stay: a user named `d3d` must not change every text.
const SHORTEST_NAME: usize = 4;

/// Texts that must not be in a report, with what stands in their place.
pub(crate) struct Scrubber(Vec<(String, &'static str)>);

impl Scrubber {
    /// For the user and the machine of this process.
    pub(crate) fn of_this_process() -> Self {
        let variables = [
            ("TEMP", "<temp>"),
            ("TMP", "<temp>"),
            ("USERPROFILE", "<home>"),
            ("HOME", "<home>"),
            ("USERNAME", "<user>"),
            ("USER", "<user>"),
            ("LOGNAME", "<user>"),
            ("COMPUTERNAME", "<machine>"),
            ("HOSTNAME", "<machine>"),
        ];
        let found = variables.iter().filter_map(|(name, shown)| Some((std::env::var(name).ok()?, *shown)));
        let host = sysinfo::System::host_name().map(|name| (name, "<machine>"));
        Self::new(found.chain(host))
    }

    fn new(texts: impl IntoIterator<Item = (String, &'static str)>) -> Self {
        let is_private = |text: &str| {
            let is_path = text.contains(['/', '\\']);
            // The home of a service or of root is no name of a person.
            if is_path { text.len() > 3 && text != "/root" } else { text.len() >= SHORTEST_NAME && text != "root" }
        };
        let mut all: Vec<_> = texts.into_iter().filter(|(text, _)| is_private(text)).collect();
        // A folder before the names that it contains.
        all.sort_by_key(|(text, _)| std::cmp::Reverse(text.len()));
        Self(all)
    }

    /// The text without personal data, in whichever case it is written.
    pub(crate) fn scrub(&self, text: &str) -> String {
        self.0.iter().fold(text.to_owned(), |text, (private, shown)| replace(&text, private, shown))
    }
}

/// Replaces all occurrences, whatever the case of ASCII letters.
fn replace(text: &str, from: &str, to: &str) -> String {
    let (lower, from) = (text.to_ascii_lowercase(), from.to_ascii_lowercase());
    let mut out = String::new();
    let mut at = 0;
    while let Some(next) = lower[at..].find(&from) {
        out += &text[at..at + next];
        out += to;
        at += next + from.len();
    }
    out + &text[at..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_and_names_are_replaced_in_any_case() {
        let private = [
            (r"C:\Users\Marion".to_owned(), "<home>"),
            ("Marion".to_owned(), "<user>"),
            (r"C:\Users\Marion\AppData\Local\Temp".to_owned(), "<temp>"),
            ("abc".to_owned(), "<user>"),
        ];
        let scrubber = Scrubber::new(private);
        let text = r"c:\users\marion\games\DirectML.dll, C:\Users\Marion\AppData\Local\Temp\x, signed for marion, abc";
        assert_eq!(scrubber.scrub(text), r"<home>\games\DirectML.dll, <temp>\x, signed for <user>, abc");
        assert_eq!(scrubber.scrub("Wärme"), "Wärme");
    }
}
