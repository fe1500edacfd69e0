//! The code blocks of pages. Every block has a language and is checked by something that knows it: a compiler, a parser, the tests of a
//! binding, or comparison with the file that it is an excerpt of, named in a comment before the block: `<!-- from FILE -->`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::tools;

use super::Context;
use super::abi::{self, Compiler, STRICT};
use super::tally::{Skip, Tally};
use crate::shell::Log;
use crate::workspace::{self, Workspace};

/// A fenced block of a page.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Block {
    /// Line number of its first line of code, from 1.
    pub(super) line: usize,
    /// Empty if the page gives none.
    pub(super) language: String,
    /// The file that it is an excerpt of, if the page names one.
    pub(super) from: Option<String>,
    pub(super) text: String,
}

/// The pages whose code is checked: those of the documentation, of samples and of bindings.
pub(super) fn pages(workspace: &Workspace) -> Result<Vec<String>, String> {
    let folders = ["docs/", "samples/host-c/", "samples/host-d3d12/", "bindings/"];
    let is_page = |file: &String| {
        file == "README.md"
            || (folders.iter().any(|folder| file.starts_with(folder))
                && Path::new(file).extension().is_some_and(|ending| ending == "md"))
    };
    Ok(workspace.files()?.into_iter().filter(is_page).collect())
}

/// Whether a page is about an engine's plugin. Its code needs that engine, so the plugin's runner compiles it.
pub(super) fn is_of_engine(page: &str) -> bool {
    ["bindings/unity/", "bindings/unreal/"].iter().any(|folder| page.starts_with(folder))
}

/// The blocks of a page.
pub(super) fn parse(page: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut open: Option<Block> = None;
    let mut before = "";
    for (number, line) in page.lines().enumerate() {
        match (line.trim_start().strip_prefix("```"), &mut open) {
            (None, Some(block)) => block.text += &format!("{line}\n"),
            (Some(_), Some(_)) => blocks.extend(open.take()),
            (Some(language), None) => {
                let from = before.trim().strip_prefix("<!-- from ").and_then(|rest| rest.strip_suffix(" -->"));
                open = Some(Block {
                    line: number + 2,
                    language: language.trim().to_owned(),
                    from: from.map(str::to_owned),
                    text: String::new(),
                });
            }
            (None, None) => {}
        }
        before = line;
    }
    blocks.extend(open);
    blocks
}

/// Checks every block of every page, compiles those in C and C++, and builds and runs the programs among them as their page says.
pub(super) fn check(context: &Context<'_>, log: &mut Log, tally: &mut Tally) -> Result<(), String> {
    let work = context.workspace.target.join("xtask").join("blocks");
    workspace::make_empty(&work)?;
    let compilers = abi::available_compilers(tally);
    for page in pages(context.workspace)? {
        let text = context.workspace.read(&page)?;
        let blocks = parse(&text);
        for block in &blocks {
            let location = format!("{page}:{}", block.line);
            let failure = match (&block.from, block.language.as_str()) {
                (Some(file), _) => {
                    let source = context.workspace.read(file);
                    source.map_or_else(Some, |source| differs(&block.text, file, &source))
                }
                (None, "cpp") if is_of_engine(&page) => None,
                (None, "c" | "cpp") => compiled(context, log, &compilers, &work, &location, block)?,
                (None, language) => unchecked(language, &page, &block.text),
            };
            log.line(&format!("{location}: {}: {}", block.language, failure.as_deref().unwrap_or("ok")))?;
            tally.check(failure.map(|why| format!("{location}: {why}")));
        }
        if let Some(block) = blocks.iter().find(|block| is_program(block)) {
            build_and_run(context, log, &work, &page, &text, block, tally)?;
        }
    }
    Ok(())
}

/// The error of a block that is neither an excerpt of a file nor read by a C compiler.
fn unchecked(language: &str, page: &str, text: &str) -> Option<String> {
    match language {
        // The same runner checks these line by line.
        "sh" | "text" => None,
        "toml" => toml::from_str::<toml::Table>(text).err().map(|e| e.to_string()),
        "json" => serde_json::from_str::<serde_json::Value>(text).err().map(|e| e.to_string()),
        // The runner `pytest` runs the Python blocks of these pages, `csharp` the C# blocks of all pages.
        "python" if page == "README.md" || page.starts_with("docs/") || page == "bindings/python/README.md" => None,
        "csharp" if !page.starts_with("bindings/unreal/") => None,
        "" => Some("the block has no language; what is no code is text".to_owned()),
        other => Some(format!("nothing here looks at {other}: name the file that it is a part of, <!-- from FILE -->")),
    }
}

/// The error if a block is not an excerpt of the file, ignoring white space.
fn differs(excerpt: &str, file: &str, source: &str) -> Option<String> {
    // A header's examples are inside comments.
    let is_header = Path::new(file).extension().is_some_and(|ending| ending == "h" || ending == "hpp");
    let plain = |line: &str| line.strip_prefix(" *").filter(|_| is_header).unwrap_or(line).to_owned();
    let source: String = source.lines().map(plain).collect::<Vec<_>>().join("\n");
    (!without_white_space(&source).contains(&without_white_space(excerpt)))
        .then(|| format!("{file} does not have this"))
}

/// A text without its white space.
fn without_white_space(text: &str) -> String {
    text.split_whitespace().collect()
}

/// Compiles a block as a source file of its own with each compiler of its language; every warning is an error.
fn compiled(
    context: &Context<'_>,
    log: &mut Log,
    compilers: &[Compiler],
    work: &Path,
    location: &str,
    block: &Block,
) -> Result<Option<String>, String> {
    let cpp = block.language == "cpp";
    let path = work.join(format!("{}.{}", location.replace(['/', '.', ':'], "-"), block.language));
    fs::write(&path, source(location, block)).map_err(|e| format!("{}: {e}", path.display()))?;
    for compiler in compilers.iter().filter(|compiler| compiler.cpp == cpp && takes_block(compiler, block)) {
        let mut command = Command::new(&compiler.program);
        command.args(compiler.first).args(if cpp { ["-std=c++17", "-Wshadow"] } else { ["-std=c11", "-Wshadow"] });
        command.args(STRICT).arg("-I").arg(context.workspace.root.join("include")).arg("-fsyntax-only").arg(&path);
        if !log.run(&mut command)?.success {
            return Ok(Some(format!("does not compile with {}", compiler.program.display())));
        }
    }
    Ok(None)
}

/// A block as a source file that keeps the line numbers of its page.
fn source(location: &str, block: &Block) -> String {
    let page = location.split(':').next().unwrap_or_default();
    let header = match (block.text.contains("#include"), block.language.as_str()) {
        (true, _) => "",
        (false, "cpp") => "#include <cairn.hpp>\n",
        (false, _) => "#include <cairn.h>\n",
    };
    format!("{header}#line {} \"{page}\"\n{}", block.line, block.text)
}

/// A block that needs Windows' own headers, or the Windows-only parts of `cairn.hpp`, goes to compilers for Windows only.
fn takes_block(compiler: &Compiler, block: &Block) -> bool {
    let windows = block.text.contains("<d3d12.h>") || (block.language == "cpp" && block.text.contains("d3d12"));
    let for_windows = compiler.program.to_string_lossy().contains("mingw") || !compiler.first.is_empty();
    for_windows || !windows
}

/// Whether the block is a whole program that the page tells its reader to build, and not one for Windows.
fn is_program(block: &Block) -> bool {
    let is_main = block.text.contains("int main(") && block.from.is_none();
    is_main && matches!(block.language.as_str(), "c" | "cpp") && !block.text.contains("d3d12")
}

/// Builds a page's program by the command line on the page, and runs it by the next one, whose last word is its output file.
fn build_and_run(
    context: &Context<'_>,
    log: &mut Log,
    work: &Path,
    page: &str,
    text: &str,
    block: &Block,
    tally: &mut Tally,
) -> Result<(), String> {
    let compiler = if block.language == "cpp" { "c++" } else { "cc" };
    let lines = super::readme::commands(text);
    let mut lines = lines.iter().skip_while(|line| !line.starts_with(&format!("{compiler} ")));
    let (Some(build), Some(run)) = (lines.next(), lines.find(|line| line.starts_with("./"))) else {
        tally.failures.push(format!("{page} does not say how its program is built with {compiler}, and run"));
        return Ok(());
    };
    if tools::on_path(compiler).is_none() {
        let reason = format!("needs {compiler}: install a C compiler");
        tally.skips.push(Skip { name: format!("the program of {page}"), reason });
        return Ok(());
    }
    let library = abi::library(context, log)?;
    let library_folder = library.parent().unwrap_or(Path::new("."));
    // By variables of the shell, since the paths may have spaces.
    let here = |line: &str| {
        line.replace("$PWD/target/release", "$LIBRARY_FOLDER")
            .replace("target/release", "\"$LIBRARY_FOLDER\"")
            .replace("-Iinclude", "-I\"$REPOSITORY\"/include")
            .replace(" samples/", " \"$REPOSITORY\"/samples/")
    };
    let work = work.join(page.replace(['/', '.'], "-"));
    let name = build.split(' ').find(|word| [".c", ".cpp"].iter().any(|ending| word.ends_with(ending)));
    let made = work.join(run.rsplit(' ').next().unwrap_or_default());
    let file: PathBuf = work.join(name.unwrap_or("first.c"));
    fs::create_dir_all(&work)
        .and_then(|()| fs::write(&file, &block.text))
        .map_err(|e| format!("{}: {e}", file.display()))?;
    for line in [build, run] {
        let mut command = Command::new("sh");
        command.env("LIBRARY_FOLDER", library_folder).env("REPOSITORY", &context.workspace.root);
        context.provide_worlds(command.args(["-c", &here(line)]).current_dir(&work))?;
        if !log.run(&mut command)?.success {
            tally.failures.push(format!("{page}: \"{line}\" fails"));
            return Ok(());
        }
    }
    let empty = fs::metadata(&made).map_or(true, |file| file.len() < 1000);
    tally.check(empty.then(|| format!("{page}: its program wrote nothing into {}", made.display())));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str =
        "text\n<!-- from a.c -->\n```c\nint a;\n```\n\n```sh\nls\n```\n- item\n  ```cpp\n  b();\n  ```\n```\nc\n```\n";

    #[test]
    fn blocks_have_language_line_and_source_file() {
        let blocks = parse(PAGE);
        let shown: Vec<_> = blocks.iter().map(|b| (b.line, b.language.as_str(), b.from.as_deref())).collect();
        assert_eq!(shown, [(4, "c", Some("a.c")), (8, "sh", None), (12, "cpp", None), (15, "", None)]);
        assert_eq!(blocks[0].text, "int a;\n");
    }

    #[test]
    fn a_block_that_no_check_reads_is_refused() {
        assert!(unchecked("", "docs/fsr.md", "").is_some() && unchecked("rust", "docs/fsr.md", "").is_some());
        assert!(
            unchecked("toml", "docs/fsr.md", "a = \n").is_some()
                && unchecked("toml", "docs/fsr.md", "a = 1\n").is_none()
        );
        assert!(
            unchecked("python", "samples/host-c/README.md", "").is_some()
                && unchecked("python", "docs/fsr.md", "").is_none()
        );
    }

    #[test]
    fn an_excerpt_is_also_found_in_a_comment() {
        assert_eq!(differs("a(b);\n  c();", "x.c", "{\n    a(b);\n    c();\n}"), None);
        assert!(differs("a(b);", "x.c", "a(c);").is_some());
        assert_eq!(differs("a(b);\nc();", "x.h", " *     a(b);\n *     c();\n"), None);
        assert!(differs("a(b);\nc();", "x.c", " *     a(b);\n *     c();\n").is_some());
    }

    #[test]
    fn sources_keep_the_line_numbers_of_their_page() {
        let blocks = parse("```c\nint a;\n```\n```cpp\n#include <vector>\n```\n");
        assert_eq!(source("docs/fsr.md:2", &blocks[0]), "#include <cairn.h>\n#line 2 \"docs/fsr.md\"\nint a;\n");
        assert_eq!(source("docs/fsr.md:5", &blocks[1]), "#line 5 \"docs/fsr.md\"\n#include <vector>\n");
    }
}
