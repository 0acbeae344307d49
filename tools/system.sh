#!/bin/sh
# Debian packages that Python wheels cannot bring: headless OpenGL (EGL on Mesa) and, where Debian
# splits it off, the venv module. Installs them when it may, else prints the one command to run.
set -u
PYTHON=${PYTHON:-python3}
missing='' who='pmcl_ros needs'
any() { for each in "$@"; do [ -e "$each" ] && return 0; done; return 1; }
have() { ldconfig -p 2>/dev/null | grep -q "$1" || any /usr/lib/*/"$1"*; }

have libEGL.so.1 || missing="$missing libegl1"
have libGL.so.1 || missing="$missing libgl1"
# A vendor's driver (NVIDIA) or Mesa's: without either EGL finds no device.
any /usr/share/glvnd/egl_vendor.d/*.json /etc/glvnd/egl_vendor.d/*.json &&
    any /usr/lib/*/dri/*_dri.so /usr/lib/*/libnvidia-eglcore.so.* ||
    missing="$missing libgl1-mesa-dri libegl-mesa0"
"$PYTHON" -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"

[ -z "$missing" ] && exit 0
command="apt-get update && apt-get install -y --no-install-recommends$missing"
if ! command -v apt-get >/dev/null 2>&1; then
    echo "$who what Debian calls$missing; install your system's packages for them" >&2
    exit 1
elif [ "$(id -u)" -eq 0 ]; then
    sudo=''
elif command -v sudo >/dev/null 2>&1 && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
    sudo=sudo
else
    echo "$who Debian packages; please run, as root:  $command" >&2
    exit 1
fi
echo "installing Debian packages:$missing"
$sudo sh -c "export DEBIAN_FRONTEND=noninteractive; $command" >/dev/null || {
    echo "that failed; please run, as root:  $command" >&2
    exit 1
}
