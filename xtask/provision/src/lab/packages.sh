# Inside the lab's Debian: Wine, a software Vulkan driver and a virtual display.
export DEBIAN_FRONTEND=noninteractive
# A lab that is lost is built again: no need to wait for the disk, nor for manuals.
cat > /etc/dpkg/dpkg.cfg.d/lab <<'END'
force-unsafe-io
path-exclude=/usr/share/doc/*
path-exclude=/usr/share/man/*
path-exclude=/usr/share/locale/*
END
dpkg --configure -a
apt-get update -q
apt-get install -q -y --no-install-recommends wine wine64 libvulkan1 mesa-vulkan-drivers xvfb
