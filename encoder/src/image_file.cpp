// SPDX-License-Identifier: Apache-2.0
#include "image_file.h"

#include <memory>

#include "stgs/format/byte_source.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_NO_STDIO
#include <stb_image.h>
#pragma GCC diagnostic pop

namespace stgs::encoder {

Result<Image8> read_image8(const std::string& path, int channels) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  constexpr std::uint64_t kLargestPicture = std::uint64_t{1} << 30;
  if (source->size() > kLargestPicture)
    return invalid_file("{}: larger than a picture can be", path);
  std::vector<std::uint8_t> bytes(source->size());
  STGS_TRY(source->read(0, bytes));
  Image8 image;
  int channels_in_file = 0;
  std::unique_ptr<stbi_uc, decltype(&stbi_image_free)> pixels(
      stbi_load_from_memory(bytes.data(), static_cast<int>(bytes.size()), &image.width,
                            &image.height, &channels_in_file, channels),
      &stbi_image_free);
  if (!pixels) {
    return invalid_file("{}: cannot decode the picture: {}", path, stbi_failure_reason());
  }
  image.channels = channels;
  image.data.assign(pixels.get(),
                    pixels.get() + std::size_t{1} * image.width * image.height * channels);
  return image;
}

}  // namespace stgs::encoder
