//! Records the calls of a test program to Direct3D 12, and checks them against the rules that Direct3D has and Vulkan has not: states of
//! resources with promotion and decay, hazards between dispatches and between queues, lifetimes of descriptors, allocators and objects, root
//! arguments, and mapped ranges. Each broken rule is a [`rules::Finding`] with the identifier of Microsoft's debug layer where it has one.
//!
//! [`recorder::Recorder`] knows no Direct3D: it is told each call with numbers for objects, on any system. On Windows `calls` tells it the
//! calls of this process.

pub mod descriptors;
pub mod recorder;
pub mod regions;
pub mod root_signature;
pub mod rules;
pub mod states;
pub mod timeline;
