//! A world against the truth, through the program: the written files, and that the truth is that of the scenes.

mod common;

use std::process::{Command, Output};

use cairn::world::ControlScript;
use common::worlds::tiny;
use scenes::{Cast, Clip, ClipOptions, Family, Scene};
use study::metrics::psnr;

fn study(arguments: &[&str]) -> (i32, String) {
    let Output { status, stdout, stderr } = Command::new(env!("CARGO_BIN_EXE_study"))
        .arg("world-quality")
        .args(arguments)
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&stderr).into_owned() + &String::from_utf8_lossy(&stdout);
    (status.code().expect("it ends by itself"), text)
}

/// PSNR of the first picture of held-out walk 0 through the level of the snow against that at `frame` fifteenths of a second, drawn anew.
fn standing_still(size: (u32, u32), frame: usize) -> f64 {
    const WALK: &str = include_str!("../../../samples/worlds/miniature/held-out-walks/snow-0.txt");
    let start = WALK.lines().find_map(|line| line.strip_prefix("# start ")).expect("a start").parse().expect("numbers");
    let (scene, script) = (Scene::level(Family::Snow, 1001, Cast::none()), ControlScript::parse(WALK).unwrap());
    let options = ClipOptions { width: size.0, height: size.1, rate: 15, start: Some(start), ..ClipOptions::default() };
    let mut clip = Clip::new(&scene, &script, options).unwrap();
    let pictures: Vec<_> = (0..=frame).map(|_| clip.frame().unwrap().picture).collect();
    psnr(&pictures[frame], &pictures[0]).unwrap()
}

#[test]
fn a_quick_look_has_every_row_and_goes_on_where_it_was() {
    let out = tempfile::tempdir().unwrap();
    let (world, folder) = (tiny(), out.path().join("quality"));
    let (world, folder) = (world.to_str().unwrap(), folder.to_str().unwrap());
    let arguments = ["--quick", "--no-lpips", "--quiet", "--world", world, "--out", folder];
    let (status, text) = study(&arguments);
    assert_eq!(status, 0, "{text}");
    assert!(
        text.contains("random weights") && text.contains("levels: 1 of 8 held-out walks of each, 5 of 60 s"),
        "{text}"
    );
    let last = text.lines().last().unwrap();
    assert!(last.starts_with("at 0.5 s: forest ") && last.matches("correlation").count() == 6, "{last}");

    let csv = std::fs::read_to_string(out.path().join("quality/world-quality.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    // Four levels and a place; 0.5, 1, 2 and 5 s; the world and two baselines; and the stock schedule up to 2 s.
    assert_eq!(rows.len(), 5 * (4 * 3 + 3), "{csv}");
    let find = |place, seconds, what| {
        rows.iter()
            .find(|row| row[0] == place && row[1] == seconds && row[2] == what)
            .unwrap_or_else(|| panic!("{csv}"))
    };
    assert_ne!(find("desert-0", "0.5", "stock")[3], find("desert-0", "0.5", "world")[3], "another schedule");
    let lasting = std::fs::read_to_string(out.path().join("quality/world-quality-lasting.csv")).unwrap();
    assert_eq!(lasting.lines().count(), 1 + 5 * 3, "1, 2 and 5 s: {lasting}");
    let expected = standing_still((128, 72), 15);
    let row = find("snow-0", "1", "repeat");
    assert!((row[3].parse::<f64>().unwrap() - expected).abs() < 1e-3, "{row:?}, {expected}");
    // The pose of a level's picture is searched for; a place that is no level has none.
    let poses = std::fs::read_to_string(out.path().join("quality/world-quality-poses.csv")).unwrap();
    assert_eq!(poses.lines().count(), 1 + 4, "{poses}");
    let away = text.lines().skip_while(|line| !line.contains("right place, %")).take_while(|line| !line.is_empty());
    assert_eq!(away.count(), 1 + 5, "a level each, and all of them: {text}");
    for name in ["good", "bad"] {
        let sheet = image::open(out.path().join(format!("quality/world-quality-{name}.png"))).unwrap();
        assert_eq!((sheet.height() - 32) % (2 * (135 + 8)), 0);
    }

    // A walk that was kept is not made again, one that is missing is, and the result is the same.
    let kept = out.path().join("quality/walks/sword-0.json");
    let before = std::fs::read(&kept).unwrap();
    std::fs::remove_file(&kept).unwrap();
    let others = std::fs::metadata(out.path().join("quality/walks/snow-0.json")).unwrap().modified().unwrap();
    let (status, again) = study(&arguments);
    assert_eq!((status, again), (0, text));
    assert!(std::fs::read(&kept).unwrap() == before, "the walk made again differs");
    assert_eq!(std::fs::metadata(out.path().join("quality/walks/snow-0.json")).unwrap().modified().unwrap(), others);
}

#[test]
fn places_that_a_world_may_have_seen_are_refused() {
    let (status, text) = study(&["--seeds", "41,1000"]);
    assert!(status == 2 && text.contains("1000") && text.contains("held-out.txt"), "{status}: {text}");
    let (status, text) = study(&["--walks", "9"]);
    assert!(status == 2 && text.contains("--walks") && text.contains("8 held-out walks"), "{status}: {text}");
}
