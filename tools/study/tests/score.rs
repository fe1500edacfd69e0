//! `study score` as a person starts it.

mod common;

use std::path::Path;
use std::process::{Command, Output};

use cairn::Picture;
use common::pairs::{Pair, pairs};
use common::weights::lpips;
use media::encode_png;
use study::metrics::{Net, psnr, ssim};

fn score(arguments: &[&str], folder: &Path) -> (i32, String, String) {
    // The weights are there before the program looks for them.
    lpips(Net::Alex);
    let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
    let Output { status, stdout, stderr } =
        command.arg("score").args(arguments).current_dir(folder).output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (status.code().expect("it ends by itself"), text(&stdout), text(&stderr))
}

fn put(folder: &Path, name: &str, picture: &Picture) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join(name), encode_png(picture).unwrap()).unwrap();
}

#[test]
fn folders_are_scored_by_name_with_means_and_a_table() {
    let home = tempfile::tempdir().unwrap();
    let (truth, mine) = (home.path().join("truth"), home.path().join("mine"));
    let pairs = pairs();
    for (Pair { truth: a, candidate: b, .. }, name) in pairs.iter().zip(["a.png", "b, c.png"]) {
        put(&truth, name, a);
        put(&mine, name, b);
    }
    let (status, shown, said) = score(&["truth", "mine", "--vgg", "--csv", "scores.csv"], home.path());
    assert_eq!(status, 0, "{said}");
    assert_eq!(shown.lines().count(), 4, "{shown}");
    let csv = std::fs::read_to_string(home.path().join("scores.csv")).unwrap();
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("picture,psnr,ssim,lpips_alex,lpips_vgg"));
    let mut sums = [0.0; 4];
    for (Pair { truth, candidate, .. }, name) in pairs.iter().zip(["a.png", "\"b, c.png\""]) {
        let values = lines.next().unwrap().strip_prefix(name).unwrap();
        let values: Vec<f64> = values.split(',').skip(1).map(|value| value.parse().unwrap()).collect();
        let by_net = |net| lpips(net).compare(truth, candidate).unwrap();
        let expected =
            [psnr(truth, candidate).unwrap(), ssim(truth, candidate).unwrap(), by_net(Net::Alex), by_net(Net::Vgg)];
        assert_eq!(values, expected, "{name}");
        values.iter().zip(&mut sums).for_each(|(value, sum)| *sum += value);
    }
    let mean = shown.lines().last().unwrap();
    let means: Vec<&str> = mean.strip_prefix("mean").unwrap().split_whitespace().collect();
    let [psnr, ssim, alex, vgg] = sums.map(|sum| sum / 2.0);
    assert_eq!(means, [format!("{psnr:.2}"), format!("{ssim:.4}"), format!("{alex:.4}"), format!("{vgg:.4}")]);
}

#[test]
fn a_picture_equals_itself() {
    let home = tempfile::tempdir().unwrap();
    put(home.path(), "a.png", &pairs()[0].truth);
    let (status, shown, said) = score(&["a.png", "a.png"], home.path());
    assert_eq!(status, 0, "{said}");
    let means: Vec<&str> = shown.lines().last().unwrap().split_whitespace().collect();
    assert_eq!(means, ["mean", "inf", "1.0000", "0.0000"]);
}

#[test]
fn what_cannot_be_compared_is_named() {
    let home = tempfile::tempdir().unwrap();
    let [small, large] = [(40, 32), (41, 32)].map(|(w, h)| Picture::new(w, h).unwrap());
    put(&home.path().join("a"), "1.png", &small);
    put(&home.path().join("b"), "1.png", &large);
    put(&home.path().join("c"), "2.png", &small);
    put(home.path(), "tiny.png", &Picture::new(12, 12).unwrap());
    std::fs::create_dir(home.path().join("empty")).unwrap();
    std::fs::write(home.path().join("text.png"), "no picture").unwrap();
    for (arguments, status, words) in [
        (["a", "b"], 2, "41 x 32"),
        (["a", "c"], 2, "no 1.png"),
        (["c", "a"], 2, "no 1.png"),
        (["a", "tiny.png"], 2, "two folders"),
        (["empty", "empty"], 2, "no PNG"),
        (["tiny.png", "tiny.png"], 2, "31 x 31"),
        (["text.png", "text.png"], 2, "text.png: it is no picture"),
        (["a/1.png", "nowhere.png"], 1, "nowhere.png"),
        (["a", "nowhere"], 1, "nowhere"),
    ] {
        let (found, shown, said) = score(&arguments, home.path());
        assert_eq!(found, status, "{arguments:?}: {shown}{said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    let (status, _, said) = score(&["tiny.png", "tiny.png", "--no-lpips"], home.path());
    assert_eq!(status, 0, "{said}");
}

#[test]
fn weights_that_are_not_there_are_named_with_the_remedy() {
    let home = tempfile::tempdir().unwrap();
    put(home.path(), "a.png", &Picture::new(40, 40).unwrap());
    let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
    command.args(["score", "a.png", "a.png"]).current_dir(home.path()).env("CAIRN_LPIPS", home.path());
    let Output { status, stderr, .. } = command.output().unwrap();
    let said = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("CAIRN_LPIPS") && said.contains("cargo xtask setup --all"), "{said}");
}
