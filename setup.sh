#!/bin/sh
# Installs what Hairlight needs of a Debian or Ubuntu system and does not find: a C and C++ compiler to
# link and to build the image metric of the tests, and lavapipe, the CPU's Vulkan driver, where there is
# no driver at all.
set -eu
packages=""
command -v cc >/dev/null && command -v c++ >/dev/null || packages="$packages g++"
ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json 2>/dev/null | grep -q . ||
    packages="$packages mesa-vulkan-drivers"
ldconfig -p 2>/dev/null | grep -q libvulkan.so.1 || packages="$packages libvulkan1"
[ -n "$packages" ] || exit 0
as_root=""
[ "$(id -u)" -eq 0 ] || as_root="sudo"
$as_root apt-get update -qq
# shellcheck disable=SC2086
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages
