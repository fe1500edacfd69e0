# After overlay.sh: copies Vulkan's validation layer from a package.
chroot run/root sh -euc '
    cd /tmp
    apt-get update -q
    apt-get download -q vulkan-validationlayers
    dpkg-deb -x vulkan-validationlayers_*.deb layer'
cd run/root/tmp/layer/usr
cp lib/x86_64-linux-gnu/libVkLayer_khronos_validation.so share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json "$2"
# The manifest names the library as one of the system's.
sed -i 's|"library_path": "lib|"library_path": "./lib|' "$2/VkLayer_khronos_validation.json"
grep -q '"library_path": "./lib' "$2/VkLayer_khronos_validation.json"
