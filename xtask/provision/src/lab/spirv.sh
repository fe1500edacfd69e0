# After overlay.sh: copies a compiler of HLSL to SPIR-V and SPIR-V's validator from packages, with the libraries that they need.
chroot run/root sh -euc '
    apt-get update -q
    apt-get install -q -y --no-install-recommends glslang-tools spirv-tools
    mkdir /tmp/spirv
    for program in glslangValidator spirv-val; do
        cp -L "/usr/bin/$program" /tmp/spirv
        ldd "/usr/bin/$program" | grep -o "/[^ ]*" | while read -r library; do
            cp -L "$library" /tmp/spirv
        done
    done'
cp run/root/tmp/spirv/* "$2"
test -x "$2/ld-linux-x86-64.so.2"
