//! Records the calls of a program to Direct3D 12, and checks them against the rules that Direct3D has and Vulkan has not: states of
//! resources with promotion and decay, layouts of enhanced barriers, memory that resources share, hazards between dispatches and between queues,
//! lifetimes of descriptors, allocators and objects, root arguments, and mapped ranges. Each broken rule is a [`rules::Finding`] with the identifier of Microsoft's debug layer where it has one.
//!
//! [`recorder::Recorder`] has no Direct3D in it: each of its methods stands for a call, with numbers for objects, on any system. On Windows
//! the library is a `d3d12.dll`: beside a program it is loaded instead of Windows' own, which it loads. It replaces functions in the tables
//! of Direct3D's objects by hooks, which report to the recorder and call the originals, so that every part of the program is recorded,
//! DirectML and AMD's libraries included. Findings go to the standard output.

#[cfg(windows)]
mod calls;
pub mod counts;
pub mod descriptors;
pub mod layouts;
pub mod recorder;
pub mod regions;
pub mod root_signature;
pub mod rules;
pub mod states;
pub mod timeline;
