# SPDX-License-Identifier: Apache-2.0
# The program stgs, without CUDA:
#   docker build -t stgs .
#   docker run --rm -v "$PWD:/work" stgs info scene.stgs
FROM debian:12-slim AS build
WORKDIR /stgs
COPY tools/setup tools/setup
RUN tools/setup/setup.sh core program web && apt-get clean
COPY . .
RUN cmake --preset release -DSTGS_WITH_CUDA=OFF -DSTGS_WITH_PLAY=OFF -DSTGS_WITH_PYTHON=OFF -DSTGS_WITH_MPI=OFF \
 && cmake --build build/release --target stgs \
 && cmake --install build/release --prefix /opt/stgs --component tools --strip
# The Debian packages of the shared libraries that the program and its modules link.
RUN ldd /opt/stgs/bin/stgs /opt/stgs/lib/*/stgs/*.so | awk '$2 == "=>" {print $3}' | xargs -n 1 realpath \
 | sed 'p;s,^/usr,,' | xargs dpkg-query --search 2>/dev/null \
 | cut -d : -f 1 | sort -u > /opt/packages

FROM debian:12-slim
COPY --from=build /opt/packages /opt/packages
RUN apt-get update \
 && xargs apt-get install --yes --no-install-recommends mesa-vulkan-drivers libvulkan1 colmap < /opt/packages \
 && rm -rf /var/lib/apt/lists/* /opt/packages
COPY --from=build /opt/stgs /usr/local
WORKDIR /work
ENTRYPOINT ["stgs"]
CMD ["--help"]
