//! Generates the function lists in `include/cairn_ld.h` from the declarations in `include/cairn.h`.

use super::declarations::{Declarations, Function};

/// Path in the repository.
pub(crate) const LOADER: &str = "include/cairn_ld.h";

/// The first line of each list, and whether the list is the one of experimental functions.
const LISTS: [(&str, bool); 2] = [("#define CAIRN_LD_FUNCTIONS(X)", false), ("#define CAIRN_LD_EXPERIMENTAL(X)", true)];

/// The loader's text with both lists generated from `declared`; everything else stays.
pub(crate) fn with_lists(text: &str, declared: &Declarations) -> Result<String, String> {
    let mut text = text.to_owned();
    for (begin, experimental) in LISTS {
        let (before, rest) = text.split_once(begin).ok_or_else(|| format!("{LOADER} has no \"{begin}\""))?;
        // An empty line ends a list.
        let (_, after) =
            rest.split_once("\n\n").ok_or_else(|| format!("{LOADER}: a list has no empty line behind it"))?;
        let functions = declared.functions.iter().filter(|function| function.experimental == experimental);
        let entries = functions.map(entry).collect::<Result<Vec<_>, _>>()?;
        let lines: String = entries.iter().map(|entry| format!(" \\\n    {entry}")).collect();
        text = format!("{before}{begin}{lines}\n\n{after}");
    }
    Ok(text)
}

/// Rewrites `result name(arguments)` as `X(result, name, (arguments))`.
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
    fn the_lists_are_replaced_and_nothing_else() {
        let header = "CAIRN_API uint32_t cairn_a(void);\nCAIRN_API const char *cairn_b(\n    cairn_x *x, size_t y);\n\
                      /** Experimental: this function may change without a new CAIRN_ABI_VERSION. */\nCAIRN_API uint32_t cairn_d(void);\n\
                      /* ---- 2. Experimental: more ---- */\nCAIRN_API uint32_t cairn_c(void);\n";
        let declared = declarations::read(header).unwrap();
        let old = "before\n#define CAIRN_LD_FUNCTIONS(X) \\\n    X(old)\n\nafter\n\n\
                   #define CAIRN_LD_EXPERIMENTAL(X)\n\nend\n";
        let text = with_lists(old, &declared).unwrap();
        let list = "#define CAIRN_LD_FUNCTIONS(X) \\\n    X(uint32_t, cairn_a, (void)) \\\n    \
                    X(const char *, cairn_b, (cairn_x *x, size_t y))";
        let more = "#define CAIRN_LD_EXPERIMENTAL(X) \\\n    X(uint32_t, cairn_d, (void)) \\\n    X(uint32_t, cairn_c, (void))";
        assert_eq!(text, format!("before\n{list}\n\nafter\n\n{more}\n\nend\n"));
        assert_eq!(with_lists(&text, &declared).unwrap(), text);
        assert!(with_lists("no list", &declared).is_err());
    }
}
