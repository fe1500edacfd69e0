//! Pipelines, root signatures and their arguments, and dispatches with them.

use std::ops::Range;

use super::{Argument, BoundTable, Command, Recorder, Use};
use crate::regions::Region;
use crate::root_signature::{DescriptorKind, Parameter};
use crate::rules::Rule;
use crate::states::{ListKind, State};
use crate::timeline::Id;

impl Recorder {
    /// `SetDescriptorHeaps`.
    pub fn set_heaps(&mut self, list: Id, heaps: Vec<Id>) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::SetDescriptorHeaps";
        let mut kinds = Vec::new();
        for &heap in &heaps {
            let Some(desc) = self.descriptors.desc(heap) else { continue };
            let (is_visible, has_samplers) = (desc.gpu.is_some(), desc.has_samplers);
            if !is_visible {
                let text = format!("shaders do not see {}", self.label(heap));
                self.find(Rule::SetHeapInvalid, FUNCTION, text);
            }
            if kinds.contains(&has_samplers) {
                let text = format!("{} is the second of its type", self.label(heap));
                self.find(Rule::SetHeapInvalid, FUNCTION, text);
            }
            kinds.push(has_samplers);
        }
        if let Some(found) = self.record(list, FUNCTION, ListKind::Compute) {
            for argument in &mut found.arguments {
                if matches!(argument, Argument::Table(heap, _) if !heaps.contains(heap)) {
                    *argument = Argument::Unset;
                }
            }
            found.used.extend(&heaps);
            found.heaps = heaps;
        }
    }

    /// `SetComputeRootSignature`.
    pub fn set_root(&mut self, list: Id, root: Id) {
        let count = self.roots.get(&root).map_or(0, |root| root.parameters.len());
        let function = "ID3D12GraphicsCommandList::SetComputeRootSignature";
        if let Some(found) = self.record(list, function, ListKind::Compute) {
            found.used.insert(root);
            if found.root != Some(root) {
                found.root = Some(root);
                found.arguments = vec![Argument::Unset; count];
            }
        }
    }

    /// `SetPipelineState`.
    pub fn set_pipeline(&mut self, list: Id, pipeline: Id) {
        let function = "ID3D12GraphicsCommandList::SetPipelineState";
        if let Some(found) = self.record(list, function, ListKind::Compute) {
            found.used.insert(pipeline);
            found.pipeline = Some(pipeline);
        }
    }

    /// The parameter of the list's root signature.
    fn parameter(&self, list: Id, parameter: u32) -> Option<&Parameter> {
        let root = self.lists.get(&list)?.root?;
        self.roots.get(&root)?.parameters.get(parameter as usize)
    }

    fn set_argument(&mut self, list: Id, function: &'static str, parameter: u32, argument: Argument) {
        if let Some(found) = self.record(list, function, ListKind::Compute)
            && let Some(place) = found.arguments.get_mut(parameter as usize)
        {
            if let (Argument::Constants(before), Argument::Constants(more)) = (&*place, &argument) {
                *place = Argument::Constants(before | more);
            } else {
                *place = argument;
            }
        }
    }

    /// `SetComputeRootDescriptorTable`.
    pub fn set_table(&mut self, list: Id, parameter: u32, address: u64) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::SetComputeRootDescriptorTable";
        if !matches!(self.parameter(list, parameter), Some(Parameter::Table(_))) {
            return self.find(Rule::SetTableInvalid, FUNCTION, format!("parameter {parameter} is no table"));
        }
        let found = self.descriptors.by_gpu(address);
        let heaps = self.lists.get(&list).map(|list| list.heaps.clone()).unwrap_or_default();
        match found.filter(|(heap, _)| heaps.contains(heap)) {
            Some((heap, index)) => self.set_argument(list, FUNCTION, parameter, Argument::Table(heap, index)),
            None => {
                let text = format!("the table at {address:#x} of parameter {parameter} is in no heap that is set");
                self.find(Rule::SetTableInvalid, FUNCTION, text);
            }
        }
    }

    /// `SetComputeRoot32BitConstants`.
    pub fn set_constants(&mut self, list: Id, parameter: u32, first: u32, count: u32) {
        const FUNCTION: &str = "ID3D12GraphicsCommandList::SetComputeRoot32BitConstants";
        match self.parameter(list, parameter) {
            Some(&Parameter::Constants(has)) if first.saturating_add(count) <= has => {
                let set = (first..first + count).fold(0, |set, bit| set | 1 << (bit % 64));
                self.set_argument(list, FUNCTION, parameter, Argument::Constants(set));
            }
            _ => {
                let text = format!("parameter {parameter} has no constants {first}..{}", first.saturating_add(count));
                self.find(Rule::SetConstantInvalid, FUNCTION, text);
            }
        }
    }

    /// The buffer that has an address for shaders, and its bytes from there on.
    pub fn buffer_at(&self, address: u64) -> Option<(Id, Range<u64>)> {
        let (&start, &id) = self.addresses.range(..=address).next_back()?;
        let bytes = self.resources.get(&id)?.desc.bytes;
        (address - start < bytes).then_some((id, address - start..bytes))
    }

    /// `SetComputeRootConstantBufferView` and the others.
    pub fn set_root_view(
        &mut self,
        list: Id,
        function: &'static str,
        parameter: u32,
        kind: DescriptorKind,
        address: u64,
    ) {
        let (rule, state) = match kind {
            DescriptorKind::Cbv => (Rule::SetRootCbvInvalid, State::CONSTANT_BUFFER),
            DescriptorKind::Uav => (Rule::SetRootUavInvalid, State::UNORDERED_ACCESS),
            _ => (Rule::SetRootSrvInvalid, State::NON_PIXEL_SHADER_RESOURCE),
        };
        if self.parameter(list, parameter) != Some(&Parameter::Descriptor(kind)) {
            return self.find(rule, function, format!("parameter {parameter} is no root {kind:?}"));
        }
        match self.buffer_at(address) {
            Some((resource, bytes)) => {
                let one = Use::new(resource, Region::Bytes(bytes), state);
                self.set_argument(list, function, parameter, Argument::Descriptor(one));
            }
            None => self.find(rule, function, format!("no buffer has the address {address:#x}")),
        }
    }

    /// `Dispatch`.
    pub fn dispatch(&mut self, list: Id) {
        self.dispatch_with(list, "ID3D12GraphicsCommandList::Dispatch", Vec::new());
    }

    /// A dispatch by `ExecuteIndirect`, which reads its arguments from a buffer, and their number from another.
    pub fn dispatch_indirect(&mut self, list: Id, arguments: Id, count: Option<Id>) {
        let state = State::INDIRECT_ARGUMENT;
        let uses = [Some(arguments), count].into_iter().flatten();
        let uses = uses.map(|resource| Use::new(resource, Region::All, state)).collect();
        self.dispatch_with(list, "ID3D12GraphicsCommandList::ExecuteIndirect", uses);
    }

    fn dispatch_with(&mut self, list: Id, function: &'static str, mut uses: Vec<Use>) {
        let Some(found) = self.record(list, function, ListKind::Compute) else { return };
        let (root, pipeline, arguments) = (found.root, found.pipeline, found.arguments.clone());
        let label = self.label(list);
        let Some(pipeline) = pipeline else {
            return self.find(Rule::PipelineNotSet, function, format!("{label} has no pipeline"));
        };
        let Some(signature) = root.and_then(|root| self.roots.get(&root)).cloned() else {
            return self.find(Rule::RootSignatureNotSet, function, format!("{label} has no root signature"));
        };
        let of_pipeline = self.pipelines.get(&pipeline).copied().flatten().and_then(|root| self.roots.get(&root));
        if of_pipeline.is_some_and(|other| *other != signature) {
            let text = format!("{} has another root signature", self.label(pipeline));
            self.find(Rule::RootSignatureMismatch, function, text);
        }
        let mut tables = Vec::new();
        for (number, (parameter, argument)) in signature.parameters.iter().zip(arguments).enumerate() {
            let missing = match (parameter, argument) {
                (Parameter::Table(_), Argument::Table(heap, first)) => {
                    tables.push(BoundTable { heap, first, root: signature.clone(), parameter: number });
                    None
                }
                (Parameter::Table(_), _) => Some(Rule::TableNotSet),
                (&Parameter::Constants(count), Argument::Constants(set)) => {
                    (set.count_ones() < count.min(64)).then_some(Rule::RootConstantsNotSet)
                }
                (&Parameter::Constants(count), _) => (count > 0).then_some(Rule::RootConstantsNotSet),
                (Parameter::Descriptor(_), Argument::Descriptor(one)) => {
                    uses.push(one);
                    None
                }
                (Parameter::Descriptor(DescriptorKind::Cbv), _) => Some(Rule::RootCbvNotSet),
                (Parameter::Descriptor(DescriptorKind::Uav), _) => Some(Rule::RootUavNotSet),
                (Parameter::Descriptor(_), _) => Some(Rule::RootSrvNotSet),
            };
            if let Some(rule) = missing {
                self.find(rule, function, format!("root parameter {number} of {label} is not set"));
            }
        }
        if let Some(found) = self.lists.get_mut(&list) {
            found.used.extend(uses.iter().map(|one| one.resource));
            self.push(list, Command::Work { function, uses, tables });
        }
    }
}
