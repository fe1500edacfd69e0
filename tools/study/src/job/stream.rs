//! The main loop: make a latent, decode its pictures, find motion and depth, present the frames that are complete.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cairn::framegen::{AnchorPair, FrameGenerator, Outcome};
use cairn::guidance::{Guidance, LatentView, latent_flow, paper, picture_flow};
use cairn::present::timeline::{Source, Stream as Kind, Timeline};
use cairn::world::{GuidanceSource, OperatingPoint, Presentation, Rollout, World, WorldTime};
use cairn::{Error, ErrorKind, Picture, Result};

use super::{Job, impossible, stopped};
use crate::inputs::LoadedInputs;
use crate::latents::LatentFile;
use crate::manifest::Counts;
use crate::settings::ParsedSettings;
use crate::sheet::Sheet;
use crate::upscaler::{Scaling, UpscalerChoice};
use media::{Recorder, WrittenFile};

/// How the loop ended without an error.
pub(super) enum End {
    /// All frames were made.
    Complete,
    /// `stop` was set.
    Stopped,
    /// The recorder stopped and knows the reason.
    RecorderGone,
}

/// State of the stream.
pub(super) struct Stream {
    point: OperatingPoint,
    timeline: Timeline,
    latent_count: u64,
    planned: u64,
    rollout: Rollout,
    render: (u32, u32),
    latent_shape: [usize; 3],
    generator: Box<dyn FrameGenerator>,
    /// Extractors allocate nothing until their first use.
    paper: paper::Extractor,
    latent_flow: latent_flow::Extractor,
    picture_flow: picture_flow::Extractor,
    guidance: Guidance,
    scaling: Scaling,
    size: (u32, u32),
    /// If anchors are upscaled before generation: the two anchors of a pair, and the guidance between them.
    larger: Option<UpscaledAnchors>,
    recorder: Recorder,
    latents: LatentFile,
    sheet: Sheet,
    /// Pictures of the current latent, after the previous anchor.
    pictures: Vec<Picture>,
    previous_anchor: Picture,
    latent: Vec<f32>,
    previous_latent: Vec<f32>,
    between: Picture,
    counts: Counts,
    times: BTreeMap<&'static str, Duration>,
}

/// Frame generator and upscaler.
pub(super) struct Makers {
    generator: Box<dyn FrameGenerator>,
    scaling: Scaling,
}

impl Makers {
    /// # Errors
    /// The generator or the upscaler is not available: missing libraries, or an unsuitable device.
    pub(super) fn new(checked: &ParsedSettings, world: &World, size: (u32, u32)) -> Result<Self> {
        let rate = checked.point.latents_per_second;
        let generator = checked.generator.make(Some(world.device()), 1000.0 / rate as f32)?;
        let scaling = checked.upscaler.make(world.render_size(), size, world.device(), rate)?;
        Ok(Self { generator, scaling })
    }
}

/// Upscaled anchors.
#[derive(Default)]
struct UpscaledAnchors {
    previous: Option<Picture>,
    current: Option<Picture>,
    guidance: Option<Guidance>,
}

/// Result of the stream.
pub(super) struct StreamReport {
    pub(super) written: Vec<WrittenFile>,
    pub(super) latents: Option<(PathBuf, u64)>,
    pub(super) sheet: Sheet,
    pub(super) counts: Counts,
    pub(super) times: BTreeMap<&'static str, Duration>,
    pub(super) failure: Option<Error>,
}

impl Stream {
    pub(super) fn new(
        checked: &ParsedSettings,
        rollout: Rollout,
        makers: Makers,
        size: (u32, u32),
        recorder: Recorder,
        latents: LatentFile,
        sheet: Sheet,
    ) -> Result<Self> {
        let point = checked.point.clone();
        let kind = match point.presentation {
            Presentation::Native => Kind::Native { dropped: point.dropped_pictures() },
            Presentation::Generated { rate, .. } => Kind::Generated { rate },
        };
        let counts = point.counts(checked.duration);
        let render = rollout.world().render_size();
        let shape = rollout.world().manifest().geometry.latent;
        let picture = || Picture::new(render.0, render.1);
        Ok(Self {
            timeline: Timeline::new(point.latents_per_second, point.pictures_per_latent, kind)?,
            latent_count: counts.latents,
            planned: counts.presented,
            render,
            latent_shape: [shape.channels, shape.height, shape.width].map(|n| n as usize),
            generator: makers.generator,
            paper: paper::Extractor::new(),
            latent_flow: latent_flow::Extractor::new(),
            picture_flow: picture_flow::Extractor::new(),
            guidance: Guidance::new(render.0, render.1, paper::PROJECTION)?,
            larger: matches!(checked.upscaler, UpscalerChoice::Fsr).then(UpscaledAnchors::default),
            scaling: makers.scaling,
            size,
            recorder,
            latents,
            sheet,
            pictures: (0..point.pictures_per_latent).map(|_| picture()).collect::<Result<_>>()?,
            previous_anchor: picture()?,
            between: if checked.upscaler == UpscalerChoice::Fsr { Picture::new(size.0, size.1)? } else { picture()? },
            latent: Vec::new(),
            previous_latent: Vec::new(),
            counts: Counts::default(),
            times: BTreeMap::new(),
            rollout,
            point,
        })
    }

    /// Runs to the end, to the limit, or until `stop` is set.
    pub(super) fn run(&mut self, job: &Job<'_>, loaded: &LoadedInputs) -> Result<End> {
        let (latents, frames) = job.limit.map_or((self.latent_count, self.planned), |l| (l.latents, l.presented));
        for number in 0..latents.min(self.latent_count) {
            if stopped(job) {
                return Ok(End::Stopped);
            }
            self.make_latent(number, loaded)?;
            let has_pair = number > 0;
            let completed = self.timeline.frames_completed_by(number);
            let due: Vec<_> = completed
                .filter(|&index| index < self.planned.min(frames))
                .map(|index| self.timeline.frame(index))
                .collect();
            let generates = due.iter().any(|frame| matches!(frame.source, Source::Generated { .. }));
            if has_pair && (generates || self.larger.is_some() || self.sheet.wants(number)) {
                self.make_guidance()?;
            }
            self.enlarge(has_pair)?;
            if self.sheet.wants(number) {
                self.keep_for_sheet(number, has_pair)?;
            }
            for frame in due {
                if stopped(job) {
                    return Ok(End::Stopped);
                }
                if !self.present(number, frame.source)? {
                    return Ok(End::RecorderGone);
                }
                job.progress.frames(self.counts.presented);
            }
        }
        Ok(End::Complete)
    }

    /// Makes latent `number`, stores it and reads back its pictures.
    fn make_latent(&mut self, number: u64, loaded: &LoadedInputs) -> Result<()> {
        let info = if let Some(stored) = &loaded.latents {
            let latent = stored.get(number).ok_or_else(|| impossible("there are fewer latents than were counted"))?;
            self.rollout.append_latent(latent)?
        } else if number == 0 {
            self.rollout.append(&loaded.seed)?
        } else {
            let (start, end): (WorldTime, WorldTime) = self.point.span_of_latent(number);
            self.rollout.step(&loaded.script.span(start, end)?)?
        };
        self.counts.passes += info.stages.denoise.count + info.stages.cache.count;
        self.counts.latents += 1;
        std::mem::swap(&mut self.latent, &mut self.previous_latent);
        self.latent.clear();
        self.latent.extend_from_slice(self.rollout.latent()?);
        let start = Instant::now();
        self.latents.push(&self.latent)?;
        self.spend("latents", start);
        if let Some(anchor) = self.pictures.last_mut() {
            std::mem::swap(anchor, &mut self.previous_anchor);
        }
        for (i, picture) in (0..).zip(&mut self.pictures) {
            self.rollout.read_picture(i, picture)?;
            self.counts.anchors += 1;
        }
        Ok(())
    }

    fn make_guidance(&mut self) -> Result<()> {
        let start = Instant::now();
        // Without generated frames only the contact sheet needs guidance: it shows the motion from latents.
        let source = match self.point.presentation {
            Presentation::Native => GuidanceSource::Paper,
            Presentation::Generated { guidance, .. } => guidance,
        };
        match source {
            GuidanceSource::Paper | GuidanceSource::LatentFlow => {
                let [c, h, w] = self.latent_shape;
                let before = LatentView::new(c, h, w, &self.previous_latent)?;
                let now = LatentView::new(c, h, w, &self.latent)?;
                if source == GuidanceSource::Paper {
                    self.paper.extract(before, now, self.render, &mut self.guidance)?;
                } else {
                    self.latent_flow.extract(before, now, self.render, &mut self.guidance)?;
                }
            }
            GuidanceSource::PictureFlow => {
                let anchor = self.pictures.last().ok_or_else(|| impossible("a latent has no picture"))?;
                self.picture_flow.extract(&self.previous_anchor, anchor, &mut self.guidance)?;
            }
            other => {
                return Err(Error::new(ErrorKind::Unsupported, format!("guidance from {other} cannot be made here"))
                    .field("guidance"));
            }
        }
        self.spend("guidance", start);
        Ok(())
    }

    /// Upscales the anchor, if that happens before generation.
    #[cfg_attr(not(windows), expect(unused_variables, reason = "only a device does it"))]
    fn enlarge(&mut self, has_pair: bool) -> Result<()> {
        #[cfg(windows)]
        if let (Scaling::Amd(upscaler), Some(larger)) = (&mut self.scaling, &mut self.larger) {
            let start = Instant::now();
            let anchor = self.pictures.last().ok_or_else(|| impossible("a latent has no picture"))?;
            let lead = has_pair.then_some(&self.guidance);
            larger.previous = larger.current.take();
            larger.current = Some(upscaler.upscale(anchor, lead)?);
            larger.guidance = lead.map(|guidance| guidance.resampled(self.size)).transpose()?;
            self.spend("upscaling", start);
        }
        Ok(())
    }

    fn keep_for_sheet(&mut self, number: u64, has_pair: bool) -> Result<()> {
        let start = Instant::now();
        let time = self.point.time_of_latent(number).seconds();
        let anchor = self.pictures.last().ok_or_else(|| impossible("a latent has no picture"))?;
        self.sheet.add(number, time, anchor, has_pair.then_some(&self.guidance))?;
        // If the decoder's other pictures are used, they lie between its anchors.
        let per_latent = self.pictures.len() as f32;
        if has_pair {
            for (i, picture) in self.pictures.iter().enumerate().take(self.pictures.len() - 1) {
                self.sheet.add_between(number, (i as f32 + 1.0) / per_latent, picture)?;
            }
        }
        self.spend("contact_sheet", start);
        Ok(())
    }

    /// Makes one frame and passes it on; `false` if the recorder has stopped.
    fn present(&mut self, number: u64, source: Source) -> Result<bool> {
        let size = self.size;
        let mut frame = match self.recorder.recycled() {
            Some(frame) => frame,
            None => Picture::new(size.0, size.1)?,
        };
        let mut generated = None;
        let picture = match source {
            Source::Native { latent, .. } if latent == number && self.larger.is_some() => {
                let current = self.larger.as_ref().and_then(|larger| larger.current.as_ref());
                current.ok_or_else(|| impossible("there is no larger anchor"))?
            }
            Source::Native { latent, picture } if latent == number => {
                self.pictures.get(picture as usize).ok_or_else(|| impossible("the timeline names no picture"))?
            }
            Source::Generated { current_latent, t, .. } if current_latent == number => {
                let start = Instant::now();
                let anchor = self.pictures.last().ok_or_else(|| impossible("a latent has no picture"))?;
                let pair = match &self.larger {
                    None => AnchorPair::new(&self.previous_anchor, anchor, &self.guidance)?,
                    Some(UpscaledAnchors {
                        previous: Some(previous),
                        current: Some(current),
                        guidance: Some(guidance),
                    }) => AnchorPair::new(previous, current, guidance)?,
                    Some(_) => return Err(impossible("there are no larger anchors")),
                };
                generated = Some(self.generator.generate(&pair, t, &mut self.between)?.outcome);
                self.sheet.add_between(number, t, &self.between)?;
                *self.times.entry("generation").or_default() += start.elapsed();
                &self.between
            }
            _ => return Err(impossible("the timeline asks for a latent that is not the current one")),
        };
        let start = Instant::now();
        match &mut self.scaling {
            Scaling::Space(upscaler) => upscaler.upscale(picture, &mut frame)?,
            #[cfg(windows)]
            Scaling::Amd(_) => frame.rgba_mut().copy_from_slice(picture.rgba()),
        }
        self.spend("upscaling", start);
        let start = Instant::now();
        let taken = self.recorder.push(frame);
        self.spend("waiting_for_recorder", start);
        if taken {
            self.counts.presented += 1;
            self.counts.generated += u64::from(generated.is_some());
            self.counts.cut_fallbacks += u64::from(generated == Some(Outcome::CutFallback));
        }
        Ok(taken)
    }

    fn spend(&mut self, stage: &'static str, start: Instant) {
        *self.times.entry(stage).or_default() += start.elapsed();
    }

    /// Closes every file.
    pub(super) fn finish(mut self) -> StreamReport {
        let start = Instant::now();
        let (written, mut failure) = match self.recorder.finish() {
            Ok(recorded) => {
                self.times.insert("recorder", recorded.busy);
                // Frames queued when the recorder failed are in no file.
                self.counts.presented = recorded.frames;
                (recorded.written, recorded.failure)
            }
            Err(error) => (Vec::new(), Some(error)),
        };
        let latents = match self.latents.close() {
            Ok(file) => Some(file),
            Err(error) => {
                failure = failure.or(Some(error));
                None
            }
        };
        self.times.insert("closing", start.elapsed());
        let stages = self.rollout.statistics().stages;
        for (name, stage) in [
            ("encode", stages.encode),
            ("denoise", stages.denoise),
            ("cache", stages.cache),
            ("commit", stages.commit),
            ("decode", stages.decode),
            ("resize", stages.resize),
        ] {
            self.times.insert(name, stage.time);
        }
        StreamReport { written, latents, sheet: self.sheet, counts: self.counts, times: self.times, failure }
    }
}
