//! Generates `bindings/csharp/src/Native.cs`: the C# declarations of everything that `include/cairn.h` declares.

use std::fmt::Write as _;

use super::declarations::{Declarations, Struct};

/// Path in the repository.
pub(crate) const NATIVE: &str = "bindings/csharp/src/Native.cs";

const OPENING: &str = "\
// Made from include/cairn.h by `cargo xtask fix`; changes here are lost.

using System;
using System.Runtime.InteropServices;

namespace Cairn
{
    // The library writes the fields that nothing here does.
#pragma warning disable 169, 649
    /// <summary>
    /// The C interface: constants, structs, callbacks and functions by their names in cairn.h, without \"cairn_\". The experimental
    /// chapters are left out: they may change within a version of the interface.
    /// </summary>
    internal static unsafe class Native
    {
";

const EXPERIMENTAL: &str = "
        /// <summary>Gives functions of a library by name, or throws.</summary>
        internal interface IResolver
        {
            T Resolve<T>(string name) where T : class;
        }

        /// <summary>
        /// The experimental functions of a loaded library. Each throws if the library is of another version, in which it may have other
        /// parameters.
        /// </summary>
        internal abstract class ExperimentalFunctions
        {
            private readonly IResolver library;

            protected ExperimentalFunctions(IResolver library)
            {
                this.library = library;
            }

";

const FUNCTIONS: &str = "            private T Resolve<T>(string name) where T : class
            {
                if (library.Resolve<version_function>(\"cairn_version\")() == VERSION) return library.Resolve<T>(name);
                string cause = $\"it is experimental, and the library is not of version {Library.Dotted(VERSION)}\";
                const string Remedy = \"Use library and assembly of the same release\";
                throw new CairnException(Result.Unsupported, $\"{name}: {cause}. {Remedy}\", name, \"\", cause, Remedy);
            }
        }

        /// <summary>Every function of a loaded library.</summary>
        internal sealed class Functions : ExperimentalFunctions
        {
";

/// Generates the file's text.
pub(crate) fn generate(declared: &Declarations) -> Result<String, String> {
    let mut text = OPENING.to_owned();
    for (name, value) in &declared.constants {
        let short = name.strip_prefix("CAIRN_").unwrap_or(name);
        match value.trim_matches(['(', ')']) {
            "UINT64_MAX" => _ = writeln!(text, "        internal const ulong {short} = ulong.MaxValue;"),
            number if number.parse::<i32>().is_ok() => {
                _ = writeln!(text, "        internal const int {short} = {number};");
            }
            other => return Err(format!("{name} is {other:?}, for which C# has no words here")),
        }
    }
    let functions: Vec<_> = declared.functions.iter().filter(|function| !function.in_experimental_chapter).collect();
    let callbacks: Vec<_> = declared.typedefs.iter().filter(|line| line.contains("(*")).collect();
    let mentions = |name: &str| {
        let has_name = |text: &str| text.split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|word| word == name);
        functions.iter().any(|function| has_name(&function.prototype)) || callbacks.iter().any(|line| has_name(line))
    };
    for found in declared.structs.iter().filter(|found| !found.fields.is_empty() && mentions(&found.name)) {
        let name = short(&found.name);
        _ = write!(
            text,
            "\n        [StructLayout(LayoutKind.Sequential)]\n        internal struct {name}\n        {{\n"
        );
        for declaration in &found.declarations {
            _ = writeln!(text, "            {}", field(declaration, declared)?);
        }
        text.push_str("        }\n");
    }
    for line in callbacks {
        let (answer, rest) = line.split_once("(*").ok_or("a callback without a name")?;
        let (name, parameters) = rest.split_once(")(").ok_or("a callback without parameters")?;
        delegate(&mut text, answer, short(name), parameters.trim_end_matches(')'), declared)?;
    }
    for function in &functions {
        let (answer, rest) = parts(&function.prototype, &function.name)?;
        delegate(&mut text, answer, &format!("{}_function", short(&function.name)), rest, declared)?;
    }
    text.push_str(EXPERIMENTAL);
    let (experimental, stable): (Vec<_>, Vec<_>) = functions.into_iter().partition(|function| function.experimental);
    for function in &experimental {
        let name = short(&function.name);
        _ = write!(
            text,
            "            internal {name}_function {name}\n            {{\n                get {{ return Resolve<{name}_function>(\"{}\"); \
             }}\n            }}\n\n",
            function.name
        );
    }
    text.push_str(FUNCTIONS);
    for function in &stable {
        let name = short(&function.name);
        _ = writeln!(text, "            internal readonly {name}_function {name};");
    }
    text.push_str("\n            internal Functions(IResolver library) : base(library)\n            {\n");
    for function in &stable {
        let name = short(&function.name);
        _ = writeln!(text, "                {name} = library.Resolve<{name}_function>(\"{}\");", function.name);
    }
    text.push_str("            }\n        }\n    }\n#pragma warning restore 169, 649\n}\n");
    Ok(text)
}

fn short(name: &str) -> &str {
    name.strip_prefix("cairn_").unwrap_or(name)
}

/// Splits `result name(parameters)` into result and parameters.
fn parts<'a>(prototype: &'a str, name: &str) -> Result<(&'a str, &'a str), String> {
    let broken = || format!("\"{prototype}\" does not declare {name}");
    let (answer, rest) = prototype.split_once(name).ok_or_else(broken)?;
    let inside = rest.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')).ok_or_else(broken)?;
    Ok((answer, inside))
}

fn delegate(
    text: &mut String,
    answer: &str,
    name: &str,
    parameters: &str,
    declared: &Declarations,
) -> Result<(), String> {
    let each = parameters.split(',').map(str::trim).filter(|parameter| *parameter != "void");
    let list: Vec<String> = each
        .map(|parameter| {
            let (kind, name) = kind_and_name(parameter);
            Ok(format!("{} {name}", translate_type(kind, declared)?))
        })
        .collect::<Result<_, String>>()?;
    // Returned strings are raw pointers: C#'s marshaller would free them otherwise.
    let answer = translate_type(answer, declared)?;
    _ = write!(
        text,
        "\n        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]\n        internal delegate {answer} {name}({});\n",
        list.join(", ")
    );
    Ok(())
}

/// Translates a field declaration of C, such as `char name[64]`, to C#.
fn field(declaration: &str, declared: &Declarations) -> Result<String, String> {
    let (single, length) = match declaration.split_once('[') {
        Some((single, rest)) => (single, Some(rest.trim_end_matches(']'))),
        None => (declaration, None),
    };
    let (kind, name) = kind_and_name(single);
    let kind = translate_type(kind, declared)?;
    Ok(match length {
        Some(length) => format!("internal fixed {kind} {name}[{length}];"),
        None => format!("internal {kind} {name};"),
    })
}

fn kind_and_name(declaration: &str) -> (&str, &str) {
    let at = declaration.rfind([' ', '*']).map_or(0, |at| at + 1);
    (&declaration[..at], &declaration[at..])
}

/// Translates a C type to C#. Pointers to opaque structs and callbacks become `IntPtr`.
fn translate_type(kind: &str, declared: &Declarations) -> Result<String, String> {
    let plain = kind.replace("const", "").replace("struct ", "");
    let stars = plain.matches('*').count();
    let base = plain.replace('*', "").trim().to_owned();
    let found = |name: &str| declared.structs.iter().find(|found| found.name == name);
    let simple = match base.as_str() {
        "void" => "void",
        "char" | "uint8_t" => "byte",
        "uint16_t" => "ushort",
        "uint32_t" => "uint",
        "int32_t" | "cairn_result" => "int",
        "uint64_t" => "ulong",
        "size_t" => "UIntPtr",
        "float" => "float",
        name => match found(name) {
            Some(Struct { fields, .. }) if !fields.is_empty() => short(name),
            Some(_) if stars > 0 => return Ok(format!("IntPtr{}", "*".repeat(stars - 1))),
            None if stars == 0 && declared.typedefs.iter().any(|line| line.contains(&format!("(*{name})"))) => "IntPtr",
            _ => return Err(format!("C# has no words here for \"{kind}\"")),
        },
    };
    Ok(format!("{simple}{}", "*".repeat(stars)))
}

#[cfg(test)]
mod tests {
    use super::super::declarations;
    use super::*;

    const HEADER: &str = "\
#define CAIRN_OK 0
#define CAIRN_ERROR_IO (-7)
#define CAIRN_FOREVER UINT64_MAX
typedef struct cairn_a cairn_a;
typedef struct cairn_b {
    uint32_t struct_size;
    const char *name;
    char text[8];
    const cairn_a *const *all;
    cairn_c told;
} cairn_b;
typedef struct cairn_guessed {
    uint32_t struct_size;
} cairn_guessed;
typedef struct cairn_unused {
    uint32_t struct_size;
} cairn_unused;
typedef uint32_t (*cairn_c)(const struct cairn_b *b, void *user);
CAIRN_API uint32_t cairn_version(void);
CAIRN_API cairn_result cairn_make(
    const cairn_b *b, float *values, size_t count, cairn_a **a);
/** Experimental: this function may change without a new CAIRN_ABI_VERSION. */
CAIRN_API cairn_result cairn_guess(cairn_guessed *x);
/* ---- 2. Experimental: tries ---- */
CAIRN_API cairn_result cairn_try(cairn_unused *x);
";

    #[test]
    fn everything_but_experimental_chapters_is_translated() {
        let text = generate(&declarations::read(HEADER).unwrap()).unwrap();
        for line in [
            "internal const int OK = 0;",
            "internal const int ERROR_IO = -7;",
            "internal const ulong FOREVER = ulong.MaxValue;",
            "internal struct b\n",
            "internal uint struct_size;",
            "internal byte* name;",
            "internal fixed byte text[8];",
            "internal IntPtr* all;",
            "internal IntPtr told;",
            "internal delegate uint c(b* b, void* user);",
            "internal delegate uint version_function();",
            "internal delegate int make_function(b* b, float* values, UIntPtr count, IntPtr* a);",
            "internal readonly make_function make;",
            "make = library.Resolve<make_function>(\"cairn_make\");",
            "internal struct guessed\n",
            "get { return Resolve<guess_function>(\"cairn_guess\"); }",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        assert!(!text.contains("unused") && !text.contains("try"), "{text}");
        assert!(!text.contains("internal readonly guess_function"), "{text}");
        assert!(text.contains("() == VERSION) return library.Resolve<T>(name);"), "{text}");
    }

    #[test]
    fn a_type_without_a_translation_is_named() {
        let header = HEADER.replace("float *values", "double *values");
        let why = generate(&declarations::read(&header).unwrap()).unwrap_err();
        assert!(why.contains("double"), "{why}");
    }
}
