# Inside a second Debian: two files of Wine with changes of ours, from Debian's own source of version $1.
#
# The library that holds its Direct3D 12 lacks two things that DirectML needs: the reader of DXIL, in which DirectML's kernels
# are written, is not compiled in, and ID3D12Device5::EnumerateMetaCommands fails where "there are none" is a legal answer.
# The server kills a program that takes half a second to end, as those do that let go of a device on a busy machine, and with
# it the exit status: it is to wait longer.
export DEBIAN_FRONTEND=noninteractive
printf 'force-unsafe-io\npath-exclude=/usr/share/doc/*\npath-exclude=/usr/share/man/*\n' > /etc/dpkg/dpkg.cfg.d/lab
sed 's/^deb /deb-src /' /etc/apt/sources.list > /etc/apt/sources.list.d/sources.list
dpkg --configure -a
apt-get update -q
apt-get install -q -y --no-install-recommends dpkg-dev gcc g++ libc6-dev make \
    gcc-mingw-w64-x86-64-win32 g++-mingw-w64-x86-64-win32 libz-mingw-w64-dev \
    flex bison gettext autoconf automake pkgconf perl libxml-libxml-perl python3 unzip \
    libvulkan-dev khronos-api unicode-data unicode-idna unicode-cldr-core
cd /root
if [ ! -d wine ]; then
    apt-get source -q --download-only "wine=$1"
    rm -rf unpacked
    dpkg-source -x --no-check "wine_$1.dsc" unpacked
    mv unpacked wine
fi
cd wine

makefile=libs/vkd3d/Makefile.in
grep -q SHADER_UNSUPPORTED_DXIL $makefile || sed -i 's/^EXTRADEFS *=/& -DVKD3D_SHADER_UNSUPPORTED_DXIL/' $makefile
grep -q '^EXTRADEFS *= -DVKD3D_SHADER_UNSUPPORTED_DXIL' $makefile
device=libs/vkd3d/libs/vkd3d/device.c
function='/d3d12_device_EnumerateMetaCommands(ID3D12Device/,/^}/'
sed -i "$function s/return E_NOTIMPL;/if (num_meta_commands) *num_meta_commands = 0; return S_OK;/" $device
sed -n "${function}p" $device | grep -q 'return S_OK'
sed -i 's|sigkill_delay >= TICKS_PER_SEC / 2)|sigkill_delay >= TICKS_PER_SEC * 64)|' server/process.c
grep -q 'sigkill_delay >= TICKS_PER_SEC \* 64)' server/process.c

# What Debian's rules do before they configure.
if [ ! -f Makefile ]; then
    # Some of its tables come from packages that are not installed; those that are needed here do not.
    ./tools/make_unicode > /dev/null 2>&1 || true
    ./tools/make_requests > /dev/null
    ./tools/make_specfiles > /dev/null
    (cd dlls/dsound && ./make_fir > /dev/null)
    (cd dlls/opengl32 && ./make_opengl > /dev/null 2>&1)
    registry=/usr/share/vulkan/registry
    (cd dlls/winevulkan && ./make_vulkan -x $registry/vk.xml -X $registry/video.xml > /dev/null 2>&1)
    grep -E '^[[:space:]]+ln -sf' debian/rules | sed 's/^[[:space:]]*//' > links.sh
    sh -e links.sh
    rm -rf libs/zlib
    autoreconf -f -i > /dev/null 2>&1
    # Nothing of this serves one library.
    ./configure --enable-win64 --with-mingw ZLIB_PE_LIBS=z --disable-tests --without-x --without-wayland --without-freetype \
        --without-fontconfig --without-opengl --without-vulkan --without-osmesa --without-opencl --without-alsa --without-pulse \
        --without-oss --without-gstreamer --without-ffmpeg --without-gnutls --without-gssapi --without-krb5 --without-dbus \
        --without-udev --without-usb --without-sane --without-v4l2 --without-gphoto --without-cups --without-sdl \
        --without-netapi --without-pcap --without-unwind --without-capi --without-pcsclite
fi
make -j"$(nproc)" dlls/wined3d/x86_64-windows/wined3d.dll server/wineserver
strip -o /root/wineserver64 server/wineserver
x86_64-w64-mingw32-strip -o /root/wined3d.dll dlls/wined3d/x86_64-windows/wined3d.dll
