// Constants of the processor's code, whose sources say what they mean. Written by `cargo xtask shaders`.

#ifndef CAIRN_CONSTANTS
#define CAIRN_CONSTANTS

// src/framegen/cpu/kernels/sampling.rs
static const int TILE = 8;

// src/framegen/cpu/kernels/lanczos.rs
static const int LANCZOS_SINC[384] = { 0, 0, 128, 0, 0, 0, 0, -2, 128, 2, 0, 0, 1, -3, 128, 3, -1, 0, 1, -5, 128, 5, -1,
    0, 2, -6, 127, 7, -2, 0, 2, -7, 126, 9, -2, 0, 2, -8, 126, 11, -3, 0, 3, -10, 125, 13, -3, 0, 3, -11, 125, 15, -4,
    0, 3, -12, 124, 18, -5, 0, 3, -13, 123, 20, -5, 0, 3, -14, 122, 22, -6, 1, 3, -15, 120, 25, -6, 1, 3, -15, 119, 27,
    -7, 1, 4, -16, 117, 30, -8, 1, 4, -17, 116, 32, -8, 1, 4, -17, 114, 35, -9, 1, 4, -18, 113, 37, -9, 1, 4, -18, 111,
    40, -10, 1, 4, -18, 109, 43, -11, 1, 4, -18, 107, 45, -11, 1, 4, -19, 105, 48, -12, 2, 4, -19, 103, 51, -13, 2, 4,
    -19, 101, 53, -13, 2, 4, -19, 98, 56, -13, 2, 4, -19, 96, 59, -14, 2, 4, -19, 94, 62, -15, 2, 4, -19, 91, 65, -15,
    2, 4, -19, 89, 67, -16, 3, 3, -18, 86, 70, -16, 3, 3, -18, 84, 73, -17, 3, 3, -18, 81, 76, -17, 3, 3, -17, 78, 78,
    -17, 3, 3, -17, 76, 81, -18, 3, 3, -17, 73, 84, -18, 3, 3, -16, 70, 86, -18, 3, 3, -16, 67, 89, -19, 4, 2, -15, 65,
    91, -19, 4, 2, -15, 62, 94, -19, 4, 2, -14, 59, 96, -19, 4, 2, -13, 56, 98, -19, 4, 2, -13, 53, 101, -19, 4, 2, -13,
    51, 103, -19, 4, 2, -12, 48, 105, -19, 4, 1, -11, 45, 107, -18, 4, 1, -11, 43, 109, -18, 4, 1, -10, 40, 111, -18, 4,
    1, -9, 37, 113, -18, 4, 1, -9, 35, 114, -17, 4, 1, -8, 32, 116, -17, 4, 1, -8, 30, 117, -16, 4, 1, -7, 27, 119, -15,
    3, 1, -6, 25, 120, -15, 3, 1, -6, 22, 122, -14, 3, 0, -5, 20, 123, -13, 3, 0, -5, 18, 124, -12, 3, 0, -4, 15, 125,
    -11, 3, 0, -3, 13, 125, -10, 3, 0, -3, 11, 126, -8, 2, 0, -2, 9, 126, -7, 2, 0, -2, 7, 127, -6, 2, 0, -1, 5, 128,
    -5, 1, 0, -1, 3, 128, -3, 1, 0, 0, 2, 128, -2, 0 };

// src/framegen/cpu/splat_key.rs
static const float MAX_MATCH_ERROR = 250;
static const uint PREVIOUS_ONLY = 254;
static const uint HOLE = 255;
static const uint MIN_INVERSE_DEPTH_BITS = 864026624;
static const int SIMILAR_MOTION = 64;
static const uint DEPTH_KEY_TOLERANCE = 32;
static const int SLOPE_MOTION = 256;
static const uint SLOPE_DEPTH_KEYS = 2048;
static const int PHASE_ONE = 4096;
static const int MAX_COMPONENT = 262080;

// src/framegen/cpu/cut.rs
static const uint CUT_TINY_FACTOR = 4;
static const int CUT_DETAIL_REACH = 4;
static const uint CUT_BLOCK = 16;
static const int CUT_SEARCH = 3;
static const float CUT_MIN_CORRELATION = 0.7;
static const float CUT_MIN_DETAIL = 1.5;
static const float CUT_MIN_SHARE = 0.125;
static const float CUT_ALONE = 0.85;
static const float CUT_WITH_HISTOGRAM = 0.6;
static const float CUT_HISTOGRAM_DISTANCE = 0.3;

// src/framegen/cpu/letterbox.rs
static const uint LETTERBOX_MAX_RANGE = 3;

// src/framegen/cpu/field.rs
static const int FIELD_UNIFORM_RANGE = 48;
static const float FIELD_DILATION_TOLERANCE = 38;
static const uint FIELD_UNKNOWN_MATCH_ERROR = 24;

// src/framegen/cpu/camera_fit.rs
static const uint2 CAMERA_FIT_SAMPLE_GRID = uint2(20, 12);
static const float CAMERA_FIT_INLIER_DISTANCE = 0.5;
static const uint CAMERA_FIT_RANSAC_TRIALS = 24;
static const uint CAMERA_FIT_TRIAL_SAMPLES = 6;
static const uint CAMERA_FIT_RANDOM[144] = { 908834774, 1093944153, 1392341196, 822192870, 1708211034, 1074839795,
    1189567130, 140486902, 1803298089, 426146746, 1601520123, 1150530802, 1682947452, 680858400, 523087034, 1610444812,
    911684890, 1228670495, 1337093332, 436429365, 1859467627, 2103721357, 1180584926, 1334893410, 831492669, 1692817328,
    1266356004, 117939872, 2071799121, 1906775968, 608200607, 1374987538, 688839708, 1175113925, 1158372494, 533141082,
    1718403786, 394474858, 37380316, 656418589, 482739455, 1369587172, 2119158410, 770417080, 1249254861, 618054934,
    399563508, 1201712901, 28406063, 391455394, 984900522, 617997544, 1364384636, 7673794, 1281938461, 2091209000,
    764341718, 2013003955, 1795705207, 157133830, 604743753, 1365789462, 507872748, 1806540341, 1415970151, 190801055,
    1141628083, 480884856, 1962063522, 266621479, 1075841442, 451693341, 740520689, 2105384108, 1690019975, 2066809988,
    79738089, 784673094, 1314613935, 1227025925, 1020159361, 211819947, 942966199, 161510978, 299002642, 554815857,
    1431204920, 40102131, 186427448, 1167932542, 1457584022, 91427608, 1937264127, 1837909334, 1489476929, 1116992738,
    781101941, 1846053444, 1510409499, 979403040, 1213155369, 425751264, 1543602590, 2132147786, 473200398, 1394691133,
    874726676, 633766899, 680606958, 623239532, 431608954, 1840424448, 1603652883, 1936177049, 602668305, 920036969,
    795010395, 1968016884, 1876175849, 1326006200, 1292171382, 307973244, 1498976071, 874638097, 1440355075, 1232874369,
    495446914, 1958416728, 340578886, 763585204, 1835566148, 1261545781, 1234806524, 1610932083, 1207922366, 1839948950,
    568697870, 1981494699, 1648148983, 887041119, 1334714574, 580271668, 801694302, 105918053 };
static const uint CAMERA_FIT_PARAMETERS = 11;

// src/framegen/cpu/splat.rs
static const int SPLAT_UNIFORM_RANGE = 48;

// src/framegen/cpu/reprojection.rs
static const float REPROJECTION_OCCLUDER_RATIO = 1.125;
static const float REPROJECTION_SAME_DEPTH = 0.03125;

// src/framegen/cpu/hole_filling.rs
static const int HOLE_FILLING_SEARCH_RADIUS = 24;

// src/framegen/cpu/render.rs
static const float RENDER_MAX_EQUAL_DIFFERENCE = 1;
static const float RENDER_DOUBT_THRESHOLD = 24;
static const float RENDER_DOUBT_THRESHOLD_OF_FLOW = 64;
static const float RENDER_STRICT_DOUBT_THRESHOLD = 4;
static const int RENDER_DISTINCT_MOTION = 8;
static const float RENDER_EDGE_TOLERANCE = 45;
static const float RENDER_OCCLUDED_DIFFERENCE = 30;
static const float RENDER_OCCLUDED_DIFFERENCE_OF_FLOW = 40;

// src/framegen/cpu/static_overlay.rs
static const float STATIC_OVERLAY_MAX_STATIC_DIFFERENCE = 4;
static const float STATIC_OVERLAY_RATIO = 2;
static const float STATIC_OVERLAY_NOISE = 2;
static const float STATIC_OVERLAY_MIN_MISMATCH = 18;
static const float STATIC_OVERLAY_MIN_CONTRAST = 12;

// src/framegen/cpu/edge_antialiasing.rs
static const int EDGE_ANTIALIASING_EDGE_MOTION = 192;
static const int EDGE_ANTIALIASING_NEIGHBOUR_WEIGHT = 10;

// src/framegen/cpu/inpaint.rs
static const float INPAINT_PARENT_WEIGHT = 0.0625;

// src/guidance/picture_flow.rs
static const float PICTURE_FLOW_FLAT_DEPTH = 0.5;

// src/guidance/picture_flow/patch.rs
static const uint PATCH_SIDE = 8;
static const float PATCH_AREA = 64;
static const float PATCH_MIN_OVERLAP = 16;
static const uint PATCH_MAX_STEPS = 8;
static const float PATCH_CONVERGED_STEP = 0.02;
static const float PATCH_SAME_START = 0.3;
static const float PATCH_MIN_IMPROVEMENT = 1;
static const float PATCH_DAMPING = 0.02;

// src/guidance/picture_flow/wide.rs
static const int WIDE_RADIUS = 8;
static const float WIDE_POOR = 200;
static const float WIDE_MAX_RATIO = 0.6;
static const float WIDE_MAX_RATIO_TO_SECOND = 0.7;
static const int WIDE_MAX_RETURN_ERROR = 1;
static const float WIDE_FAR = 1048576;

// src/guidance/picture_flow/model.rs
static const uint MODEL_N = 8;
static const float MODEL_RIDGE = 0.00001;
static const uint MODEL_PARTS = 64;
static const uint MODEL_SUMS = 21;

// src/guidance/picture_flow/grid.rs
static const float GRID_LAMBDA = 0.3;
static const float GRID_NOISE = 1;
static const float GRID_LUMA_SCALE = 25;
static const float GRID_DISCONTINUITY = 0.5;
static const float GRID_HALF_WEIGHT_INFORMATION = 4;
static const float GRID_MAX_EXTRAPOLATED_STEP = 2;

// src/guidance/picture_flow/dense.rs
static const int DENSE_BLOCK = 8;
static const int DENSE_RADIUS = 2;
static const uint DENSE_BLOCK_WITH_MARGIN = 12;
static const uint DENSE_MAX_CANDIDATES = 8;
static const float DENSE_MERGE_DISTANCE = 0.25;
static const float DENSE_SAME_SURFACE = 1;
static const float DENSE_MAX_DIFFERENCE = 20;
static const float DENSE_OUTSIDE_DIFFERENCE = 8;
static const float DENSE_MISMATCH = 16;
static const uint DENSE_ORDER_OF_9[9] = { 4, 3, 5, 1, 7, 0, 2, 6, 8 };
static const uint DENSE_ORDER_OF_16[16] = { 5, 6, 9, 10, 1, 2, 4, 7, 8, 11, 13, 14, 0, 3, 12, 15 };

// src/guidance/picture_flow/consistency.rs
static const float CONSISTENCY_TOLERANCE = 0.5;
static const float CONSISTENCY_TOLERANCE_PER_LENGTH = 0.01;
static const uint CONSISTENCY_STEPS[14] = { 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 86 };
static const float CONSISTENCY_COLOUR_SCALE = 20;
static const int CONSISTENCY_MIN_GRADIENT_STEPS = 8;
static const float CONSISTENCY_EDGE_GRADIENT = 0.3;

// src/guidance/resample.rs
static const float RESAMPLE_MAX_DIFFERENCE = 1;

// src/guidance/paper.rs
static const float PAPER_COMPRESSION = 8;

#endif
