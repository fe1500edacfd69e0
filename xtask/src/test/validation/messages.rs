//! The layer's messages in the output of test programs.

use serde::Deserialize;

/// A message of the layer.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(in crate::test) struct Message {
    /// Identifier of the broken rule, such as `VUID-VkImageMemoryBarrier-oldLayout-01197`.
    #[serde(rename = "VUID")]
    pub(in crate::test) id: String,
    /// The Vulkan function whose call is reported.
    #[serde(rename = "Function")]
    pub(in crate::test) function: String,
    #[serde(rename = "MainMessage")]
    pub(in crate::test) text: String,
    /// The test that ran, `PROGRAM TEST`; empty before the first.
    #[serde(skip)]
    pub(in crate::test) test: String,
}

/// Start of a message, as the layer writes it as JSON.
const START: &str = "{\n\t\"Severity\"";

/// Separates the layer's messages from the rest of the output of `cargo test`, whose tests run one at a time: then a message follows the name
/// of its test.
///
/// # Errors
/// A message is not the JSON that the layer writes.
pub(in crate::test) fn separate(output: &str) -> Result<(String, Vec<Message>), String> {
    let (mut rest, mut messages) = (String::new(), Vec::new());
    let mut left = output;
    let (mut program, mut test) = (String::new(), String::new());
    while let Some(at) = left.find(START) {
        let (before, message) = left.split_at(at);
        rest += before;
        for line in before.lines() {
            if let Some(name) = line.trim_start().strip_prefix("Running ") {
                (program, test) = (program_of(name), String::new());
            } else if let Some((name, _)) = line.strip_prefix("test ").and_then(|line| line.split_once(" ... ")) {
                test = name.trim().to_owned();
            }
        }
        let mut values = serde_json::Deserializer::from_str(message).into_iter::<Message>();
        let mut parsed = match values.next() {
            Some(Ok(parsed)) => parsed,
            Some(Err(e)) => return Err(format!("a message of the layer is not as expected: {e}: {}", head(message))),
            None => return Err(format!("a message of the layer is cut off: {}", head(message))),
        };
        parsed.test = [program.as_str(), test.as_str()].join(" ").trim().to_owned();
        messages.push(parsed);
        let end = &message[values.byte_offset()..];
        left = end.strip_prefix('\n').unwrap_or(end);
    }
    rest += left;
    Ok((rest, messages))
}

/// `d3d12_shaders` of `tests/d3d12_shaders.rs (target/...)`, and `d3d12_generator` of `tests/d3d12_generator/main.rs (target/...)`.
fn program_of(source: &str) -> String {
    let path = source.split(" (").next().unwrap_or_default().replace('\\', "/");
    let path = path.strip_suffix("/main.rs").or_else(|| path.strip_suffix(".rs")).unwrap_or(&path);
    path.rsplit('/').next().unwrap_or_default().to_owned()
}

/// The first characters of a text.
fn head(text: &str) -> String {
    text.chars().take(200).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MESSAGE: &str = "{\n\t\"Severity\" : \"Error\",\n\t\"VUID\" : \"SYNC-HAZARD\",\n\t\"Objects\" : [\n\t\t{\"type\" : \"VkQueue\", \"handle\" : \"0x7f\", \"name\" : \"\"}\n\t],\n\t\"MessageID\" : \"0xe4d96472\",\n\t\"Function\" : \"vkCmdDispatch\",\n\t\"Location\" : \"\",\n\t\"MainMessage\" : \"a hazard {0}\\nin two lines\",\n\t\"DebugRegion\" : \"\",\n\t\"SpecText\" : \"\",\n\t\"SpecUrl\" : \"\"\n}\n";

    #[test]
    fn messages_belong_to_the_test_that_runs_and_the_rest_is_what_libtest_writes() {
        let output = format!(
            "{MESSAGE}     Running tests/d3d12_shaders.rs (target/deps/d3d12_shaders-1.exe)\n\nrunning 2 tests\n\
             test a ... ok\ntest b::c ... {MESSAGE}{MESSAGE}ok\n\ntest result: ok. 2 passed;\n     \
             Running tests/d3d12_generator/main.rs (target/deps/d3d12_generator-1.exe)\ntest d ... {MESSAGE}FAILED\n"
        );
        let (rest, messages) = separate(&output).unwrap();
        assert_eq!(rest, output.replace(MESSAGE, ""));
        assert!(rest.contains("test b::c ... ok\n") && rest.contains("test d ... FAILED\n"), "{rest}");
        let tests: Vec<_> = messages.iter().map(|message| message.test.as_str()).collect();
        assert_eq!(tests, ["", "d3d12_shaders b::c", "d3d12_shaders b::c", "d3d12_generator d"]);
        let expected = ("SYNC-HAZARD", "vkCmdDispatch", "a hazard {0}\nin two lines");
        assert!(messages.iter().all(|m| (m.id.as_str(), m.function.as_str(), m.text.as_str()) == expected));
    }

    #[test]
    fn output_without_messages_is_kept_and_a_broken_message_is_an_error() {
        assert_eq!(separate("test a ... ok\n{\n}\n").unwrap(), ("test a ... ok\n{\n}\n".to_owned(), Vec::new()));
        assert!(separate(&MESSAGE[..60]).is_err());
        assert!(separate(&MESSAGE.replace("\"Function\"", "\"Fanction\"")).unwrap_err().contains("Function"));
    }
}
