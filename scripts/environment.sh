#!/usr/bin/env bash
# Virtual environments of the scripts. Other scripts source this file, from the root of the repository. It needs Python
# 3.11 or newer with venv.
#
#   scripts/environment.sh GROUP    makes the environment of a group, e.g. nightly, and prints its interpreter
#
# Functions:
#   environment GROUP    prints the interpreter of .runtime/GROUP, which holds the packages of that group of
#                        pyproject.toml, at the versions of scripts/constraints.txt; `python` and `rerun` also find
#                        the package in scripts/python
#   train_environment    prints the interpreter of .runtime/train, which has the package of scripts/train, and Debian's
#                        PyTorch if python3-torch is installed
#
# An environment is made if it is missing, and made again if its packages or versions change.

# install_packages_into FOLDER LOCK PACKAGE...: uv takes a tenth of pip's time. It is in the environment of the group `lock`.
# Where it cannot install, for example because only pip knows the mirror in use, pip does, and uv is not tried again.
install_packages_into() {
  local folder=$1 lock=$2 uv
  shift 2
  if [[ $folder != .runtime/lock ]] && uv=$(dirname "$(environment lock)")/uv && [[ ! -e .runtime/lock/no-uv ]]; then
    UV_HTTP_TIMEOUT=30 "$uv" pip install --quiet --system-certs --python "$folder/bin/python" \
      --constraints "$lock" --build-constraints "$lock" "$@" && return
    echo "uv could not install these packages: pip installs them" >&2
    touch .runtime/lock/no-uv
  fi
  # pip splits these variables at white space.
  local constraints=file://${PWD// /%20}/$lock
  PIP_CONSTRAINT=$constraints PIP_BUILD_CONSTRAINT=$constraints "$folder/bin/python" -m pip install \
    --quiet --disable-pip-version-check "$@"
}

# make_environment FOLDER INTERPRETER LOCK VENV_OPTIONS PACKAGE...
make_environment() {
  local folder=$1 interpreter=$2 lock=$3 options=$4 wanted
  shift 4
  wanted=$(printf '%s\n' "$("$interpreter" --version) $interpreter $options $*" && cat "$lock")
  if [[ ! -x $folder/bin/python || $(cat "$folder/wanted.txt" 2>/dev/null) != "$wanted" ]]; then
    # shellcheck disable=SC2086 # the options are words
    "$interpreter" -m venv --clear $options "$folder" || return
    install_packages_into "$folder" "$lock" "$@" >&2 || return
    printf '%s\n' "$wanted" >"$folder/wanted.txt"
  fi
  printf '%s\n' "$PWD/$folder/bin/python"
}

# packages_of FILE GROUP: prints the packages of a group of a pyproject.toml, one per line.
packages_of() {
  python3 - "$@" <<'PYTHON'
import sys, tomllib

groups = tomllib.load(open(sys.argv[1], "rb"))["dependency-groups"]
if sys.argv[2] not in groups:
    sys.exit(f"{sys.argv[1]} has no group {sys.argv[2]}, only {', '.join(groups)}")
print(*groups[sys.argv[2]], sep="\n")
PYTHON
}

environment() {
  local packages python
  mapfile -t packages < <(packages_of pyproject.toml "$1")
  ((${#packages[@]})) || return 1
  python=$(make_environment ".runtime/$1" python3 scripts/constraints.txt "" "${packages[@]}") || return
  if [[ $1 == python || $1 == rerun ]]; then
    "$python" -c 'import sys, sysconfig; open(sysconfig.get_path("purelib") + "/checkout.pth", "w").write(sys.argv[1])' \
      "$PWD/scripts/python"
  fi
  printf '%s\n' "$python"
}

# PYTHON names an interpreter of your own, which must have the package: pip install --editable scripts/train.
train_environment() {
  if [[ -n ${PYTHON:-} ]]; then
    "$PYTHON" -c 'import roadplane_train' || {
      echo "$PYTHON has no roadplane_train: $PYTHON -m pip install --editable scripts/train" >&2
      return 1
    }
    printf '%s\n' "$PYTHON"
    return
  fi
  local interpreter=python3 options=
  if /usr/bin/python3 -c 'import torch' 2>/dev/null; then
    interpreter=/usr/bin/python3 options=--system-site-packages
  fi
  make_environment .runtime/train "$interpreter" scripts/train/constraints.txt "$options" --editable 'scripts/train[test]'
}

if [[ ${BASH_SOURCE[0]} == "$0" ]]; then
  set -euo pipefail
  [[ $# == 1 ]] || { sed -n '2,/^$/s/^# \{0,1\}//p' "$0"; exit 2; }
  cd "$(dirname "$0")/.."
  environment "$1"
fi
