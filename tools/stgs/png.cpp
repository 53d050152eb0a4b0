// SPDX-License-Identifier: Apache-2.0
#include "png.h"

#include <cstddef>
#include <cstring>
#include <memory_resource>
#include <new>

namespace {

// stb does not check all of its allocations. Here they throw, and the arena
// frees the rest. Set while stb encodes.
thread_local std::pmr::memory_resource* arena = nullptr;

void* take(std::size_t bytes) {
  return arena->allocate(bytes, alignof(std::max_align_t));
}
void* take_more(const void* old, std::size_t old_bytes, std::size_t bytes) {
  void* const memory = take(bytes);
  if (old != nullptr) std::memcpy(memory, old, old_bytes);
  return memory;
}

}  // namespace

#define STBIW_MALLOC(bytes) take(bytes)
#define STBIW_REALLOC_SIZED(old, old_bytes, bytes) take_more(old, old_bytes, bytes)
#define STBIW_FREE(memory) (static_cast<void>(memory))
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STBI_WRITE_NO_STDIO
#include <stb_image_write.h>

namespace stgs::tools {

std::vector<std::uint8_t> encode_png(const encoder::Image8& image) {
  std::pmr::monotonic_buffer_resource memory(image.data.size() + (64 << 10));
  arena = &memory;
  std::vector<std::uint8_t> bytes;
  const auto append = [](void* context, void* data, int size) {
    const auto* from = static_cast<const std::uint8_t*>(data);
    static_cast<std::vector<std::uint8_t>*>(context)->assign(from, from + size);
  };
  const int written = stbi_write_png_to_func(append, &bytes, image.width, image.height, 3,
                                             image.data.data(), image.width * 3);
  if (written == 0) throw std::bad_alloc();
  return bytes;
}

}  // namespace stgs::tools
