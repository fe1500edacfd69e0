//! A Windows program that prints its arguments, variables and files, to test what the lab passes through.

use std::io::{Read, Write};
use std::time::Duration;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["arguments", ref rest @ ..] => rest.iter().for_each(|argument| println!("{argument}")),
        ["variable", name] => println!("{}", std::env::var(name).expect("the variable")),
        ["folder"] => println!("{}", std::env::current_dir().expect("a folder").display()),
        ["file", path] => print!("{}", std::fs::read_to_string(path).expect("the file")),
        ["copy"] => {
            let mut bytes = Vec::new();
            std::io::stdin().read_to_end(&mut bytes).expect("standard input");
            std::io::stdout().write_all(&bytes).expect("standard output");
            eprint!("{} bytes", bytes.len());
        }
        ["exit", status] => std::process::exit(status.parse().expect("a number")),
        ["crash"] => std::process::abort(),
        // Runs until it is ended, and starts a child that would outlive it.
        ["stay", mark] => {
            if mark != "child" {
                let own = std::env::current_exe().expect("a path");
                std::process::Command::new(own).args(["stay", "child"]).spawn().expect("a child");
                std::fs::write(mark, "").expect("the mark");
            }
            loop {
                std::thread::sleep(Duration::from_secs(1));
            }
        }
        ref others => panic!("it knows no {others:?}"),
    }
}
