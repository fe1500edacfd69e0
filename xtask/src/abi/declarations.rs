//! Parses the header's declarations. The header is generated, so its lines have few forms.

/// A function with the comment above it.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Function {
    pub(crate) name: String,
    /// On one line, without `CAIRN_API` and semicolon.
    pub(crate) prototype: String,
    /// Whether it may still change within a version of the interface.
    pub(crate) experimental: bool,
    /// Whether all of its chapter is experimental.
    pub(crate) in_experimental_chapter: bool,
    /// Without comment marks, one line to an entry.
    pub(crate) comment: Vec<String>,
}

/// What the comment of an experimental function says if its chapter is not experimental.
const EXPERIMENTAL: &str = "Experimental: this function may change without a new CAIRN_ABI_VERSION.";

/// A struct and its fields; an opaque struct has none.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Struct {
    pub(crate) name: String,
    pub(crate) fields: Vec<String>,
    /// Declarations of the same fields, without semicolons.
    pub(crate) declarations: Vec<String>,
}

/// Everything that a header declares, in its order.
#[derive(Debug, Default)]
pub(crate) struct Declarations {
    /// Names and values, as in the header.
    pub(crate) constants: Vec<(String, String)>,
    pub(crate) structs: Vec<Struct>,
    pub(crate) functions: Vec<Function>,
    /// Typedefs of function pointers and other types, as in the header.
    pub(crate) typedefs: Vec<String>,
}

/// Parses a header.
pub(crate) fn read(header: &str) -> Result<Declarations, String> {
    let mut found = Declarations::default();
    let mut comment: Vec<String> = Vec::new();
    let mut lines = header.lines();
    let mut in_experimental_chapter = false;
    while let Some(line) = lines.next() {
        if line.starts_with("/* ---- ") {
            in_experimental_chapter = line.contains(". Experimental: ");
        } else if let Some(start) = line.strip_prefix("/**") {
            comment = vec![start.trim_end_matches("*/").trim().to_owned()];
            if !line.ends_with("*/") {
                let inside = lines.by_ref().take_while(|line| !line.ends_with("*/"));
                comment.extend(inside.map(|line| line.trim_start().trim_start_matches('*').trim().to_owned()));
            }
        } else if let Some(start) = line.strip_prefix("CAIRN_API ") {
            let prototype = until(start, &mut lines, ';')?;
            let name = prototype.split('(').next().and_then(|head| head.rsplit([' ', '*']).next()).unwrap_or_default();
            let comment = std::mem::take(&mut comment);
            found.functions.push(Function {
                name: name.to_owned(),
                prototype: prototype.clone(),
                // The sentence may span lines.
                experimental: in_experimental_chapter || comment.join(" ").contains(EXPERIMENTAL),
                in_experimental_chapter,
                comment,
            });
        } else if let Some(rest) = line.strip_prefix("#define CAIRN_") {
            // The include guard and the linkage macros are not constants of the interface.
            if let Some((name, value)) = rest.split_once(' ').filter(|(_, value)| !value.starts_with("__")) {
                found.constants.push((format!("CAIRN_{name}"), value.to_owned()));
            }
        } else if let Some(rest) = line.strip_prefix("typedef struct ") {
            let name = rest.split([' ', ';']).next().unwrap_or_default().to_owned();
            let declarations = if line.ends_with('{') { members(&mut lines) } else { Vec::new() };
            let fields = declarations.iter().map(|declaration| field_name(declaration)).collect();
            found.structs.push(Struct { name, fields, declarations });
        } else if let Some(rest) = line.strip_prefix("typedef ") {
            found.typedefs.push(until(rest, &mut lines, ';')?);
        }
    }
    Ok(found)
}

/// Joins a declaration that may span several lines, up to but not including `end`.
fn until<'a>(start: &str, lines: &mut impl Iterator<Item = &'a str>, end: char) -> Result<String, String> {
    let mut text = start.trim().to_owned();
    while !text.ends_with(end) {
        let line = lines.next().ok_or_else(|| format!("the header ends within {text:?}"))?;
        if !text.ends_with('(') {
            text.push(' ');
        }
        text.push_str(line.trim());
    }
    Ok(text.trim_end_matches(end).to_owned())
}

/// Declarations of a struct's fields, up to its closing brace.
fn members<'a>(lines: &mut impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut members = Vec::new();
    for line in lines {
        let line = line.trim();
        if line.starts_with('}') {
            break;
        }
        let declaration = line.strip_suffix(';').filter(|line| !line.starts_with(['*', '/']));
        members.extend(declaration.map(str::to_owned));
    }
    members
}

/// The name in a field's declaration.
fn field_name(declaration: &str) -> String {
    let head = declaration.split('[').next().unwrap_or_default();
    head.rsplit([' ', '*']).next().unwrap_or_default().to_owned()
}

/// The first part that a function's comment lacks; `None` when it has all parts in their order.
pub(crate) fn missing_part(function: &Function, constants: &[(String, String)], version: &str) -> Option<String> {
    let lacks = |what: &str| Some(format!("{}: {what}", function.name));
    let text = function.comment.join("\n");
    let summary = function.comment.iter().find(|line| !line.is_empty());
    if summary.is_none_or(|line| line.contains(':') && line.starts_with("Ownership")) {
        return lacks("no summary");
    }
    let mut parts = Vec::new();
    for part in ["Ownership: ", "Threads: ", "Results: ", "Since: "] {
        match text.find(&format!("\n{part}")) {
            Some(at) if parts.last().is_none_or(|(before, _)| *before < at) => parts.push((at, part)),
            Some(_) => return lacks(&format!("\"{part}\" is out of order")),
            None => return lacks(&format!("no \"{part}\"")),
        }
    }
    let part = |i: usize| &text[parts[i].0..parts.get(i + 1).map_or(text.len(), |next| next.0)];
    let ownership = part(0).to_lowercase();
    if !ownership.contains("on success") && !ownership.contains("copied") || !ownership.contains("on failure") {
        return lacks("\"Ownership\" does not say what holds on success and on failure");
    }
    let results = part(2);
    let named: Vec<&str> =
        results.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|w| w.starts_with("CAIRN_")).collect();
    if let Some(unknown) = named.iter().find(|name| !constants.iter().any(|(known, _)| known == *name)) {
        return lacks(&format!("\"Results\" names {unknown}, which is not there"));
    }
    if function.prototype.starts_with("cairn_result ") && !named.contains(&"CAIRN_OK") {
        return lacks("\"Results\" does not name CAIRN_OK");
    }
    let since = part(3).trim_start_matches("\nSince: ").trim();
    let number = |text: &str| -> Option<Vec<u32>> { text.split('.').map(|part| part.parse().ok()).collect() };
    match (number(since), number(version)) {
        (Some(since), Some(now)) if since.len() == 3 && since <= now => None,
        _ => lacks(&format!("\"Since\" names {since:?}, which is no version up to {version}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "\
#define CAIRN_H
#define CAIRN_API __declspec(dllimport)
#define CAIRN_API
/** It worked. */
#define CAIRN_OK 0
typedef struct cairn_a cairn_a;
typedef struct cairn_b {
    /** x */
    uint32_t struct_size;
    /**
     * Two lines; with a stop.
     */
    const char *name;
    char text[8];
} cairn_b;
/** A callback. */
typedef uint32_t (*cairn_c)(const cairn_b *b,
                            void *user);
/**
 * Makes one.
 *
 * Ownership: on success yours; on failure not.
 * Threads: any.
 * Results: CAIRN_OK.
 * Since: 0.1.0
 */
CAIRN_API cairn_result cairn_make(
    cairn_a **a, size_t b);
/**
 * Guesses. Experimental: this function may change without a new
 * CAIRN_ABI_VERSION.
 */
CAIRN_API cairn_result cairn_guess(void);
/* ---- 2. Experimental: tries ---- */
CAIRN_API cairn_result cairn_try(void);
";

    #[test]
    fn all_declarations_are_found() {
        let found = read(HEADER).unwrap();
        assert_eq!(found.constants, [("CAIRN_OK".to_owned(), "0".to_owned())]);
        let names: Vec<_> = found.structs.iter().map(|s| (s.name.as_str(), s.fields.len())).collect();
        assert_eq!(names, [("cairn_a", 0), ("cairn_b", 3)]);
        assert_eq!(found.structs[1].fields, ["struct_size", "name", "text"]);
        assert_eq!(found.structs[1].declarations, ["uint32_t struct_size", "const char *name", "char text[8]"]);
        assert_eq!(found.typedefs, ["uint32_t (*cairn_c)(const cairn_b *b, void *user)"]);
        assert_eq!(found.functions[0].prototype, "cairn_result cairn_make(cairn_a **a, size_t b)");
        assert_eq!(found.functions[0].name, "cairn_make");
        let experimental: Vec<_> =
            found.functions.iter().map(|f| (f.name.as_str(), f.experimental, f.in_experimental_chapter)).collect();
        let expected = [("cairn_make", false, false), ("cairn_guess", true, false), ("cairn_try", true, true)];
        assert_eq!(experimental, expected);
        assert_eq!(missing_part(&found.functions[0], &found.constants, "0.1.0"), None);
    }

    #[test]
    fn every_missing_part_is_noticed() {
        for (from, to) in [
            (" * Makes one.\n *\n", ""),
            (" * Ownership: on success yours; on failure not.\n", ""),
            ("; on failure not", ""),
            (" * Threads: any.\n", ""),
            (" * Results: CAIRN_OK.\n", ""),
            ("Results: CAIRN_OK", "Results: CAIRN_FINE, CAIRN_OK"),
            ("Results: CAIRN_OK", "Results: always works"),
            (" * Since: 0.1.0\n", ""),
            ("Since: 0.1.0", "Since: 0.2.0"),
            ("Since: 0.1.0", "Since: soon"),
            (" * Threads: any.\n * Results: CAIRN_OK.\n", " * Results: CAIRN_OK.\n * Threads: any.\n"),
        ] {
            let changed = HEADER.replace(from, to);
            assert_ne!(changed, HEADER);
            let found = read(&changed).unwrap();
            assert!(missing_part(&found.functions[0], &found.constants, "0.1.0").is_some(), "{from:?} -> {to:?}");
        }
    }
}
