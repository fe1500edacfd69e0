//! Layouts of ffx-api's structs as data, written from its published headers and independent of the bindings.

/// The type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FieldType {
    /// The struct id. It is never changed to another struct's id: the reader would read beyond the struct.
    Id,
    /// An unsigned number or flags, with its size in bytes.
    Number(usize),
    /// A signed 32-bit number.
    Signed,
    /// An `f32`.
    Float,
    /// A pointer. It is changed to null only: any other address would be invalid.
    Pointer,
    /// Eight bytes that the call writes; their input value does not matter.
    Answer,
}

impl FieldType {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::Number(size) => size,
            Self::Signed | Self::Float => 4,
            Self::Id | Self::Pointer | Self::Answer => 8,
        }
    }
}

/// A field: name, offset and type.
pub(crate) type Field = (String, usize, FieldType);

/// A struct: id, name, and fields in order.
pub(crate) struct Struct {
    pub(crate) id: u64,
    pub(crate) name: &'static str,
    pub(crate) fields: Vec<Field>,
}

/// Parses a struct: each word is a field, `NAME:OFFSET:KIND`.
fn read(id: u64, name: &'static str, size: usize, text: &str) -> Struct {
    let mut fields = vec![("type".to_owned(), 0, FieldType::Id), ("next".to_owned(), 8, FieldType::Pointer)];
    for word in text.split_whitespace() {
        let parts: Vec<_> = word.split(':').collect();
        let [field, offset, kind] = parts[..] else { panic!("{word}") };
        let offset: usize = offset.parse().expect("an offset");
        let mut several = |parts: &[(&str, FieldType)]| {
            let mut at = offset;
            for (part, kind) in parts {
                fields.push((format!("{field}.{part}"), at, *kind));
                at += kind.size();
            }
        };
        const U32: FieldType = FieldType::Number(4);
        match kind {
            "u8" => fields.push((field.to_owned(), offset, FieldType::Number(1))),
            "u32" => fields.push((field.to_owned(), offset, U32)),
            "u64" => fields.push((field.to_owned(), offset, FieldType::Number(8))),
            "f32" => fields.push((field.to_owned(), offset, FieldType::Float)),
            "answer" => fields.push((field.to_owned(), offset, FieldType::Answer)),
            "pointer" => fields.push((field.to_owned(), offset, FieldType::Pointer)),
            "size" => several(&[("width", U32), ("height", U32)]),
            "pair" => several(&[("x", FieldType::Float), ("y", FieldType::Float)]),
            "vector" => several(&[("x", FieldType::Float), ("y", FieldType::Float), ("z", FieldType::Float)]),
            "rect" => {
                several(&[
                    ("left", FieldType::Signed),
                    ("top", FieldType::Signed),
                    ("width", FieldType::Signed),
                    ("height", FieldType::Signed),
                ]);
            }
            "resource" => several(&[
                ("resource", FieldType::Pointer),
                ("type", U32),
                ("format", U32),
                ("width", U32),
                ("height", U32),
                ("depth", U32),
                ("mips", U32),
                ("flags", U32),
                ("usage", U32),
                ("state", U32),
            ]),
            other => panic!("{other} is no kind"),
        }
    }
    // Fields are in order, with only alignment padding between them.
    let mut end = 0;
    for (field, offset, kind) in &fields {
        assert!(*offset >= end && *offset - end < 8 && offset.is_multiple_of(kind.size().min(8)), "{name}.{field}");
        end = offset + kind.size();
    }
    assert!(end <= size && size - end < 8, "{name}");
    Struct { id, name, fields }
}

/// Structs that query and create contexts.
pub(crate) fn creation_structs() -> Vec<Struct> {
    vec![
        read(
            0x4,
            "GetVersions",
            56,
            "createDescType:16:u64 device:24:pointer outputCount:32:pointer versionIds:40:pointer versionNames:48:pointer",
        ),
        read(0x7, "GlobalDebug", 40, "effectId:16:u64 fpMessage:24:pointer debugLevel:32:u32"),
        read(
            0x2_0001,
            "CreateFrameGeneration",
            40,
            "flags:16:u32 displaySize:20:size maxRenderSize:28:size backBufferFormat:36:u32",
        ),
        read(0x2_000e, "FrameGenerationVersion", 24, "version:16:u32"),
        read(0x2_0009, "FrameGenerationHudless", 24, "hudlessBackBufferFormat:16:u32"),
        read(0x5, "OverrideVersion", 24, "versionId:16:u64"),
        read(0x2, "BackendDX12", 24, "device:16:pointer"),
        read(0x6, "GetProviderVersion", 32, "versionId:16:answer versionName:24:answer"),
    ]
}

/// Structs of a generated frame that all releases share.
pub(crate) fn frame_structs() -> Vec<Struct> {
    vec![
        read(
            0x2_0002,
            "ConfigureFrameGeneration",
            144,
            "swapChain:16:pointer presentCallback:24:pointer presentCallbackUserContext:32:pointer frameGenerationCallback:40:pointer frameGenerationCallbackUserContext:48:pointer frameGenerationEnabled:56:u8 allowAsyncWorkloads:57:u8 HUDLessColor:64:resource flags:112:u32 onlyPresentGenerated:116:u8 generationRect:120:rect frameID:136:u64",
        ),
        read(0x2_0008, "RegisterDistortionField", 64, "distortionField:16:resource"),
        read(
            0x2_0003,
            "DispatchFrameGeneration",
            312,
            "commandList:16:pointer presentColor:24:resource outputs0:72:resource outputs1:120:resource outputs2:168:resource outputs3:216:resource numGeneratedFrames:264:u32 reset:268:u8 backbufferTransferFunction:272:u32 minMaxLuminance:276:pair generationRect:284:rect frameID:304:u64",
        ),
    ]
}

/// The prepare struct from SDK 2.1 on.
pub(crate) fn prepare_structs_v2() -> Vec<Struct> {
    vec![read(
        0x2_000c,
        "PrepareV2",
        232,
        "frameID:16:u64 flags:24:u32 commandList:32:pointer renderSize:40:size jitterOffset:48:pair motionVectorScale:56:pair frameTimeDelta:64:f32 reset:68:u8 cameraNear:72:f32 cameraFar:76:f32 cameraFovAngleVertical:80:f32 viewSpaceToMetersFactor:84:f32 depth:88:resource motionVectors:136:resource cameraPosition:184:vector cameraUp:196:vector cameraRight:208:vector cameraForward:220:vector",
    )]
}

/// The prepare structs up to SDK 2.0.
pub(crate) fn prepare_structs() -> Vec<Struct> {
    vec![
        read(
            0x2_0004,
            "Prepare",
            184,
            "frameID:16:u64 flags:24:u32 commandList:32:pointer renderSize:40:size jitterOffset:48:pair motionVectorScale:56:pair frameTimeDelta:64:f32 unused_reset:68:u8 cameraNear:72:f32 cameraFar:76:f32 cameraFovAngleVertical:80:f32 viewSpaceToMetersFactor:84:f32 depth:88:resource motionVectors:136:resource",
        ),
        read(
            0x2_000a,
            "PrepareCameraInfo",
            64,
            "cameraPosition:16:vector cameraUp:28:vector cameraRight:40:vector cameraForward:52:vector",
        ),
    ]
}

/// Structs that create upscalers.
pub(crate) fn upscaler_creation_structs() -> Vec<Struct> {
    vec![
        read(
            0x1_0000,
            "CreateUpscale",
            48,
            "flags:16:u32 maxRenderSize:20:size maxUpscaleSize:28:size fpMessage:40:pointer",
        ),
        read(0x1_000b, "UpscaleVersion", 24, "version:16:u32"),
        read(0x2, "BackendDX12", 24, "device:16:pointer"),
    ]
}

/// Structs of an upscaled frame.
pub(crate) fn upscale_structs() -> Vec<Struct> {
    vec![read(
        0x1_0001,
        "DispatchUpscale",
        432,
        "commandList:16:pointer color:24:resource depth:72:resource motionVectors:120:resource exposure:168:resource \
         reactive:216:resource transparencyAndComposition:264:resource output:312:resource jitterOffset:360:pair \
         motionVectorScale:368:pair renderSize:376:size upscaleSize:384:size enableSharpening:392:u8 sharpness:396:f32 \
         frameTimeDelta:400:f32 preExposure:404:f32 reset:408:u8 cameraNear:412:f32 cameraFar:416:f32 \
         cameraFovAngleVertical:420:f32 viewSpaceToMetersFactor:424:f32 flags:428:u32",
    )]
}

/// Structs of a reactive mask.
pub(crate) fn mask_structs() -> Vec<Struct> {
    vec![read(
        0x1_0006,
        "DispatchUpscaleGenerateReactiveMask",
        192,
        "commandList:16:pointer colorOpaqueOnly:24:resource colorPreUpscale:72:resource outReactive:120:resource \
         renderSize:168:size scale:176:f32 cutoffThreshold:180:f32 binaryValue:184:f32 flags:188:u32",
    )]
}
