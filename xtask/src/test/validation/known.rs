//! `xtask/validation.toml`: messages of the layer that calls without the library cause as well.

use serde::Deserialize;

use super::messages::Message;

/// The list's path.
pub(super) const LIST: &str = "xtask/validation.toml";

/// The list.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct KnownMessages {
    #[serde(default, rename = "message")]
    entries: Vec<Entry>,
}

/// Messages with one cause.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    id: String,
    function: String,
    /// A part of the text.
    text: String,
    /// The test without the library that causes it.
    shown_by: String,
    /// Why it is not the library's.
    reason: String,
}

impl KnownMessages {
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let list: Self = toml::from_str(text).map_err(|e| format!("{LIST}: {e}"))?;
        let is_empty = |text: &String| text.trim().is_empty();
        match list.entries.iter().find(|entry| [&entry.id, &entry.shown_by, &entry.reason].into_iter().any(is_empty)) {
            Some(entry) => Err(format!("{LIST}: the entry \"{}\" needs an id, a test and a reason", entry.id)),
            None => Ok(list),
        }
    }

    /// One line per test, identifier and function of messages that are not in the list, with the first text.
    pub(super) fn unknown(&self, messages: &[Message]) -> Vec<String> {
        let mut groups: Vec<(&Message, usize)> = Vec::new();
        for message in messages.iter().filter(|message| !self.entries.iter().any(|entry| entry.covers(message))) {
            let is_same = |known: &Message| {
                (&known.test, &known.id, &known.function) == (&message.test, &message.id, &message.function)
            };
            match groups.iter_mut().find(|(known, _)| is_same(known)) {
                Some((_, count)) => *count += 1,
                None => groups.push((message, 1)),
            }
        }
        let line = |(Message { id, function, text, test }, count): (&Message, usize)| {
            format!("{test}: {id} in {function}, {count} times: {}", text.replace('\n', " "))
        };
        groups.into_iter().map(line).collect()
    }

    /// The entries whose own test causes no such message, which are no longer needed.
    pub(super) fn not_shown(&self, messages: &[Message]) -> Vec<String> {
        let is_shown = |entry: &Entry| {
            messages.iter().any(|message| entry.covers(message) && message.test.ends_with(entry.shown_by.as_str()))
        };
        let missing = self.entries.iter().filter(|entry| !is_shown(entry));
        missing.map(|entry| format!("{} in {} by {}", entry.id, entry.function, entry.shown_by)).collect()
    }
}

impl Entry {
    fn covers(&self, message: &Message) -> bool {
        message.id == self.id && message.function == self.function && message.text.contains(&self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[[message]]\nid = \"SYNC\"\nfunction = \"vkQueueSubmit\"\ntext = \"vkCmdCopyBuffer \"\n\
                        shown_by = \"copies\"\nreason = \"no barrier between submissions\"\n";

    fn message(id: &str, function: &str, text: &str, test: &str) -> Message {
        Message { id: id.into(), function: function.into(), text: text.into(), test: test.into() }
    }

    #[test]
    fn only_messages_of_the_same_rule_function_and_text_are_known() {
        let list = KnownMessages::parse(TEXT).unwrap();
        let known = message("SYNC", "vkQueueSubmit", "vkCmdCopyBuffer reads", "p t");
        assert_eq!(list.unknown(std::slice::from_ref(&known)), [""; 0]);
        let others = [
            message("SINK", "vkQueueSubmit", "vkCmdCopyBuffer reads", "p t"),
            message("SYNC", "vkCmdDispatch", "vkCmdCopyBuffer reads", "p t"),
            message("SYNC", "vkQueueSubmit", "vkCmdCopyImage reads", "p t"),
        ];
        for other in others {
            assert_eq!(list.unknown(&[known.clone(), other]).len(), 1);
        }
    }

    #[test]
    fn equal_messages_of_a_test_are_one_line() {
        let found = |test: &str, text: &str| message("SINK", "vkCmdDispatch", text, test);
        let messages = [found("p a", "one\nline"), found("p a", "other"), found("p b", "third")];
        let lines = KnownMessages::default().unknown(&messages);
        assert_eq!(
            lines,
            ["p a: SINK in vkCmdDispatch, 2 times: one line", "p b: SINK in vkCmdDispatch, 1 times: third"]
        );
    }

    #[test]
    fn an_entry_that_its_own_test_does_not_show_is_reported() {
        let list = KnownMessages::parse(TEXT).unwrap();
        let by = |test: &str| [message("SYNC", "vkQueueSubmit", "vkCmdCopyBuffer reads", test)];
        assert_eq!(list.not_shown(&by("d3d12_validation system_calls::copies")), [""; 0]);
        assert_eq!(list.not_shown(&by("d3d12_flow pairs")), ["SYNC in vkQueueSubmit by copies"]);
        assert_eq!(list.not_shown(&[]).len(), 1);
    }

    #[test]
    fn the_committed_list_is_readable_and_an_entry_without_a_reason_is_refused() {
        let list = KnownMessages::parse(include_str!("../../../validation.toml")).unwrap();
        assert!(!list.entries.is_empty());
        assert!(KnownMessages::parse(&TEXT.replace("no barrier between submissions", " ")).is_err());
        assert!(KnownMessages::parse(&TEXT.replace("reason", "raison")).is_err());
    }
}
