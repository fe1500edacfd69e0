//! The list of functions in `include/cairn_ld.h`, written from what `include/cairn.h` declares.

use super::declarations::{Declarations, Function};

/// Where it lies.
pub(crate) const LOADER: &str = "include/cairn_ld.h";

const BEGIN: &str = "#define CAIRN_LD_FUNCTIONS(X)";

/// The loader's text with the list that `declared` asks for; everything around it stays.
pub(crate) fn with_list(text: &str, declared: &Declarations) -> Result<String, String> {
    let (before, rest) = text.split_once(BEGIN).ok_or_else(|| format!("{LOADER} has no \"{BEGIN}\""))?;
    // The list ends with the first line that does not go on.
    let (_, after) =
        rest.split_once("\n\n").ok_or_else(|| format!("{LOADER}: the list has no empty line behind it"))?;
    let entries = declared.functions.iter().map(entry).collect::<Result<Vec<_>, _>>()?;
    Ok(format!("{before}{BEGIN} \\\n    {}\n\n{after}", entries.join(" \\\n    ")))
}

/// `result name(arguments)` as `X(result, name, (arguments))`.
fn entry(function: &Function) -> Result<String, String> {
    let Function { name, prototype, .. } = function;
    let (result, arguments) =
        prototype.split_once(name.as_str()).ok_or_else(|| format!("\"{prototype}\" does not declare {name}"))?;
    Ok(format!("X({}, {name}, {arguments})", result.trim_end()))
}

#[cfg(test)]
mod tests {
    use super::super::declarations;
    use super::*;

    #[test]
    fn the_list_is_replaced_and_nothing_else() {
        let header = "CAIRN_API uint32_t cairn_a(void);\nCAIRN_API const char *cairn_b(\n    cairn_x *x, size_t y);\n";
        let declared = declarations::read(header).unwrap();
        let text =
            with_list("before\n#define CAIRN_LD_FUNCTIONS(X) \\\n    X(old)\n\nafter\n\nend\n", &declared).unwrap();
        let list = "#define CAIRN_LD_FUNCTIONS(X) \\\n    X(uint32_t, cairn_a, (void)) \\\n    \
                    X(const char *, cairn_b, (cairn_x *x, size_t y))";
        assert_eq!(text, format!("before\n{list}\n\nafter\n\nend\n"));
        assert_eq!(with_list(&text, &declared).unwrap(), text);
        assert!(with_list("no list", &declared).is_err());
    }
}
