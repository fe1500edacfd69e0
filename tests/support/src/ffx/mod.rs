//! AMD's libraries and the double of them: folders with copies of the double, textures of a frame, and a window with a swap chain.

pub mod double_folder;
pub mod failing_calls;
pub mod frame_textures;
pub mod window;
pub mod world_in_rect;
