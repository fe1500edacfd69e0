# Inside the lab, in folder $0: runs a Linux program in it.
unset LAB_INSIDE
shift
cd "$0"
export HOME="${HOME:-/root}" LC_ALL="${LC_ALL:-C.UTF-8}"
export VK_DRIVER_FILES="${VK_DRIVER_FILES:-/usr/share/vulkan/icd.d/lvp_icd.json}"
# Mesa's compiled shaders call functions of libm, which they look for among the program's own libraries. A program in Rust has it only
# as a library of other libraries.
export LD_PRELOAD="${LD_PRELOAD:-libm.so.6}"
# ONNX Runtime offers a GPU's provider only if it finds a GPU here, whose folder has a PCI address as its name. The numbers are
# those of a virtio GPU; the provider itself asks Vulkan for a device.
gpu=/sys/devices/pci0000:00/0000:00:01.0
mkdir -p "$gpu" /sys/class/drm/card0
echo 0x1af4 > "$gpu/vendor"
echo 0x1050 > "$gpu/device"
ln -s "$gpu" /sys/class/drm/card0/device
# Not with exec: the first process of a namespace ignores signals that it does not handle, SIGABRT among them.
status=0
"$@" || status=$?
exit $status
