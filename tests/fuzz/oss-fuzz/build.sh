#!/bin/bash -eu
# SPDX-License-Identifier: Apache-2.0
# Builds the fuzz targets for OSS-Fuzz: programs, options, dictionaries and seed corpora in $OUT.
#
# The environment is that of OSS-Fuzz: $CC, $CXX, $CFLAGS, $CXXFLAGS, $LIB_FUZZING_ENGINE, $SRC (with stgs and the
# sources that the Dockerfile fetches), $WORK (optional) and $OUT. Further variables, for runs outside of it:
#   STGS_SYSTEM_LIBRARIES=1   uses the libraries of the system, which are neither instrumented nor static
#   STGS_TARGETS="ply spz"    builds these targets only
#   STGS_CMAKE="-D..."        further options of CMake
source_folder=$SRC/stgs
work=${WORK:-$SRC/work}
prefix=$work/prefix
jobs=$(nproc)
mkdir -p "$work" "$OUT"

# build_library FOLDER [OPTIONS...]: a static library, with the flags of the environment
build_library() {
  local folder=$1
  shift
  cmake -S "$SRC/$folder" -B "$work/${folder//\//_}" -G Ninja -DCMAKE_BUILD_TYPE=None -DBUILD_SHARED_LIBS=OFF \
        -DCMAKE_INSTALL_PREFIX="$prefix" -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_PREFIX_PATH="$prefix" \
        -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DBUILD_TESTING=OFF "$@"
  cmake --build "$work/${folder//\//_}" -j "$jobs" --target install
}

build_libraries() {
  (cd "$SRC/zlib" && ./configure --static --prefix="$prefix" && make -j "$jobs" install)
  build_library fmt -DFMT_TEST=OFF -DFMT_DOC=OFF
  build_library highway -DHWY_ENABLE_TESTS=OFF -DHWY_ENABLE_EXAMPLES=OFF -DHWY_ENABLE_CONTRIB=OFF
  build_library libdeflate -DLIBDEFLATE_BUILD_SHARED_LIB=OFF -DLIBDEFLATE_BUILD_GZIP=OFF
  build_library xxHash/cmake_unofficial -DXXHASH_BUILD_XXHSUM=OFF
  build_library zstd/build/cmake -DZSTD_BUILD_SHARED=OFF -DZSTD_BUILD_PROGRAMS=OFF -DZSTD_BUILD_TESTS=OFF
  build_library libwebp -DWEBP_BUILD_ANIM_UTILS=OFF -DWEBP_BUILD_CWEBP=OFF -DWEBP_BUILD_DWEBP=OFF \
                -DWEBP_BUILD_GIF2WEBP=OFF -DWEBP_BUILD_IMG2WEBP=OFF -DWEBP_BUILD_VWEBP=OFF \
                -DWEBP_BUILD_WEBPINFO=OFF -DWEBP_BUILD_WEBPMUX=OFF -DWEBP_BUILD_EXTRAS=OFF
  build_library libzip -DENABLE_BZIP2=OFF -DENABLE_LZMA=OFF -DENABLE_ZSTD=OFF -DENABLE_OPENSSL=OFF \
                -DENABLE_GNUTLS=OFF -DENABLE_MBEDTLS=OFF -DENABLE_COMMONCRYPTO=OFF -DBUILD_TOOLS=OFF \
                -DBUILD_REGRESS=OFF -DBUILD_EXAMPLES=OFF -DBUILD_DOC=OFF -DBUILD_OSSFUZZ=OFF
  build_library draco -DDRACO_TESTS=OFF
  export PKG_CONFIG_PATH=$prefix/lib/pkgconfig
  # Not in a folder that CMake searches.
  draco_DIR=$(dirname "$(find "$prefix" -name draco-config.cmake)")
  export draco_DIR
}

if [ "${STGS_SYSTEM_LIBRARIES:-0}" != 1 ]; then
  build_libraries
fi

# No build type: the flags of the environment decide. --static: pkg-config also names what static libraries need.
cmake -S "$source_folder" -B "$work/stgs" -G Ninja -DCMAKE_BUILD_TYPE=None -DCMAKE_PREFIX_PATH="$prefix" \
      -DPKG_CONFIG_ARGN="$([ "${STGS_SYSTEM_LIBRARIES:-0}" = 1 ] || echo --static)" \
      -DSTGS_FUZZER=ON -DSTGS_FUZZ_ENGINE="$LIB_FUZZING_ENGINE" -DSTGS_CCACHE=OFF -DSTGS_WITH_CUDA=OFF \
      -DSTGS_WITH_VULKAN=OFF -DSTGS_WITH_HTTP=OFF -DSTGS_WITH_PREPARE=OFF -DSTGS_WITH_MPI=OFF \
      -DSTGS_WITH_PYTHON=OFF -DSTGS_WITH_DRACO=ON -DSTGS_WITH_SOG=ON -DSTGS_WITH_ENCODER=ON \
      -DSTGS_BUILD_PROGRAM=OFF -DSTGS_BUILD_EXAMPLES=OFF -DSTGS_INSTALL=OFF ${STGS_CMAKE:-}

# pack NAME FOLDERS...: the corpus of a target: the seeds that its plain driver writes, and these folders
pack() {
  local name=$1 seeds=$work/seeds/$1
  shift
  rm -rf "$seeds" "$OUT/fuzz_${name}_seed_corpus.zip"
  "$work/stgs/bin/fuzz_$name" --write-seeds "$seeds"
  (cd "$seeds" && zip -q "$OUT/fuzz_${name}_seed_corpus.zip" ./*)
  for folder in "$@"; do
    (cd "$folder" && find . -maxdepth 1 -type f | LC_ALL=C sort | zip -q "$OUT/fuzz_${name}_seed_corpus.zip" -@)
  done
}

# CMake lists the targets: NAME;FOLDER;...
while IFS=';' read -r -a row; do
  name=${row[0]}
  if [ -n "${STGS_TARGETS:-}" ] && [[ " $STGS_TARGETS " != *" $name "* ]]; then
    continue
  fi
  cmake --build "$work/stgs" -j "$jobs" --target "fuzz_$name" "libfuzzer_$name"
  cp "$work/stgs/bin/libfuzzer_$name" "$OUT/fuzz_$name"
  cp "$source_folder/tests/fuzz/oss-fuzz/fuzz_$name.options" "$OUT/"
  pack "${row[@]}"
done < "$work/stgs/tests/fuzz/targets.txt"
cp "$source_folder"/tests/fuzz/oss-fuzz/*.dict "$OUT/"
