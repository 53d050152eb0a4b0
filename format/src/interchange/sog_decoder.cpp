// SPDX-License-Identifier: Apache-2.0
#include "interchange/sog_decoder.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "interchange/import.h"

namespace stgs {
namespace {

constexpr std::size_t kPaletteRow = 64;  // palette entries per row of the image of centroids

// An image has a pixel per splat and fills its last rows. Decoding takes time for each pixel.
Status check_pixels(const ImageSize& size, std::size_t count, const std::string& label) {
  constexpr std::uint64_t kInAnyImage = 4096, kPerSplat = 16;
  if (size.pixels() < count) {
    return invalid_file("{}: image too small ({} x {} pixels for {} splats)", label, size.width,
                        size.height, count);
  }
  if (size.pixels() <= kInAnyImage + kPerSplat * count) return {};
  return unsupported("{}: image too large ({} x {} pixels for {} splats)", label, size.width,
                     size.height, count);
}

// One axis of a range, at q of `max`.
float exponential(const SogRange& range, std::size_t axis, std::size_t q) {
  const double span = range.maxs[axis] - range.mins[axis];
  const double mapped = range.mins[axis] + span * (static_cast<double>(q) / 65535);
  return static_cast<float>(std::copysign(std::expm1(std::abs(mapped)), mapped));
}

}  // namespace

Status check_sog_count(NamedFiles& files, const SogLayout& layout, std::size_t count,
                       const std::string& folder, ImportMemory& memory) {
  const std::string& name = layout.means.files[0];
  STGS_ASSIGN(const ChargedBytes bytes, files.read(folder + name, memory));
  STGS_ASSIGN(const ImageSize size, lossless_webp_size(bytes.value, files.label(folder + name)));
  return check_pixels(size, count, files.label(folder + name));
}

Result<ImageRgba> sog_centroids(NamedFiles& files, const SogPalette& palette,
                                ImportMemory& memory) {
  STGS_ASSIGN(const ChargedBytes bytes, files.read(palette.centroids, memory));
  STGS_ASSIGN(ImageRgba image,
              decode_lossless_webp(bytes.value, files.label(palette.centroids), memory));
  const auto width = static_cast<std::size_t>(image.width);
  const auto height = static_cast<std::size_t>(image.height);
  if (width != kPaletteRow * palette.coefficients() || height * kPaletteRow < palette.entries) {
    return invalid_file("{}: wrong image size ({} x {} pixels for {} entries of {} coefficients)",
                        files.label(palette.centroids), width, height, palette.entries,
                        palette.coefficients());
  }
  return image;
}

SogDecoder::SogDecoder(NamedFiles& files, const SogLayout& layout, const ImageRgba* centroids,
                       ImportMemory& memory, std::size_t count, std::string folder)
    : files_(files),
      layout_(layout),
      centroids_(centroids),
      memory_(memory),
      count_(count),
      folder_(std::move(folder)) {}

Status SogDecoder::read_into(Gaussians4D& set, std::size_t first) {
  STGS_TRY(read_logarithms(layout_.means, "means", set.position.data() + 3 * first));
  STGS_TRY(read_scales(set, first));
  STGS_TRY(read_rotations(set, first));
  STGS_TRY(read_colours(set, first));
  return layout_.palette ? read_sh(set, first) : Status();
}

Result<ImageRgba> SogDecoder::splat_image(const std::string& name) {
  STGS_ASSIGN(const ChargedBytes bytes, files_.read(folder_ + name, memory_));
  STGS_ASSIGN(const ImageSize size, lossless_webp_size(bytes.value, label(name)));
  STGS_TRY(check_pixels(size, count_, label(name)));
  if (!size_) size_ = size;
  if (size != *size_) {
    return invalid_file("{}: image size differs within the model (expected {} x {}, got {} x {})",
                        label(name), size_->width, size_->height, size.width, size.height);
  }
  return decode_lossless_webp(bytes.value, label(name), memory_);
}

Status SogDecoder::read_logarithms(const SogRange& range, const char* label, float* out) {
  STGS_ASSIGN(const ImageRgba low, splat_image(range.files[0]));
  STGS_ASSIGN(const ImageRgba high, splat_image(range.files[1]));
  for (std::size_t c = 0; c < 3; ++c) {
    if (!std::isfinite(exponential(range, c, 0)) || !std::isfinite(exponential(range, c, 65535))) {
      return invalid_file("{}: {}.mins[{}] or {}.maxs[{}] exceed the range of binary32",
                          files_.label("meta.json"), label, c, label, c);
    }
    const auto code = [&](std::size_t i) {
      return low.pixel(i)[c] | std::size_t{high.pixel(i)[c]} << 8;
    };
    std::vector<float> table(1 << 16);
    if (count_ < table.size()) {
      each([&](std::size_t i) { out[3 * i + c] = exponential(range, c, code(i)); });
      continue;
    }
    for (std::size_t q = 0; q < table.size(); ++q) table[q] = exponential(range, c, q);
    each([&](std::size_t i) { out[3 * i + c] = table[code(i)]; });
  }
  return {};
}

Status SogDecoder::check_indices(const ImageRgba& image, std::size_t channel, std::size_t entries,
                                 const std::string& name) const {
  for (std::size_t i = 0; entries < 256 && i < count_; ++i) {
    if (image.pixel(i)[channel] >= entries) {
      return invalid_file("{}: invalid index {} of splat {} (the codebook has {} entries)",
                          label(name), image.pixel(i)[channel], i, entries);
    }
  }
  return {};
}

Status SogDecoder::read_scales(Gaussians4D& set, std::size_t first) {
  STGS_ASSIGN(const ImageRgba image, splat_image(layout_.scales_file));
  for (std::size_t c = 0; c < 3; ++c) {
    STGS_TRY(check_indices(image, c, layout_.scales.size(), layout_.scales_file));
  }
  each([&](std::size_t i) {
    for (std::size_t c = 0; c < 3; ++c) {
      set.log_scale[3 * (first + i) + c] = layout_.scales[image.pixel(i)[c]];
    }
  });
  return {};
}

// Alpha gives the index of the largest of w x y z; the others follow in order, each within
// +-1/sqrt(2).
Status SogDecoder::read_rotations(Gaussians4D& set, std::size_t first) {
  STGS_ASSIGN(const ImageRgba image, splat_image(layout_.quats_file));
  for (std::size_t i = 0; i < count_; ++i) {
    if (image.pixel(i)[3] < 252) {
      return invalid_file("{}: invalid alpha of splat {} (expected 252 to 255, got {})",
                          label(layout_.quats_file), i, image.pixel(i)[3]);
    }
  }
  each([&](std::size_t i) {
    const std::uint8_t* pixel = image.pixel(i);
    float* q = set.rotation.data() + 4 * (first + i);
    const std::size_t largest = pixel[3] - std::size_t{252};
    double rest = 1;
    for (std::size_t c = 0, from = 0; c < 4; ++c) {
      if (c == largest) continue;
      const double value = (pixel[from++] / 255.0 * 2 - 1) * std::sqrt(0.5);
      q[c] = static_cast<float>(value);
      rest -= value * value;
    }
    q[largest] = static_cast<float>(std::sqrt(std::max(0.0, rest)));
  });
  return {};
}

Status SogDecoder::read_colours(Gaussians4D& set, std::size_t first) {
  STGS_ASSIGN(const ImageRgba image, splat_image(layout_.sh0_file));
  for (std::size_t c = 0; c < 3; ++c) {
    STGS_TRY(check_indices(image, c, layout_.sh0.size(), layout_.sh0_file));
  }
  const std::size_t stride = 3 * static_cast<std::size_t>(set.sh_coefficients());
  std::array<float, 256> logit;
  for (int a = 0; a < 256; ++a) logit[static_cast<std::size_t>(a)] = logit_of_byte(a);
  each([&](std::size_t i) {
    const std::uint8_t* pixel = image.pixel(i);
    for (std::size_t c = 0; c < 3; ++c) set.sh[stride * (first + i) + c] = layout_.sh0[pixel[c]];
    set.opacity_logit[first + i] = logit[pixel[3]];
  });
  return {};
}

// Each splat has a label of 16 bits, the index of a palette entry, whose coefficients are adjacent
// in the image of centroids.
Status SogDecoder::read_sh(Gaussians4D& set, std::size_t first) {
  const SogPalette& palette = *layout_.palette;
  const std::size_t coefficients = palette.coefficients();
  const auto width = static_cast<std::size_t>(centroids_->width);
  STGS_ASSIGN(const ImageRgba labels, splat_image(palette.labels));
  const auto label_of = [&](std::size_t i) {
    return labels.pixel(i)[0] | std::size_t{labels.pixel(i)[1]} << 8;
  };
  const auto first_pixel = [&](std::size_t entry) {
    return entry / kPaletteRow * width + entry % kPaletteRow * coefficients;
  };
  for (std::size_t i = 0; i < count_; ++i) {
    if (label_of(i) >= palette.entries) {
      return invalid_file("{}: invalid label {} of splat {} (the palette has {} entries)",
                          label(palette.labels), label_of(i), i, palette.entries);
    }
  }
  Codebook book = palette.codebook;
  const std::size_t entries = book.size();
  book.resize(256, NAN);  // an index beyond the entries is found below
  const std::size_t stride = 3 * static_cast<std::size_t>(set.sh_coefficients());
  each([&](std::size_t i) {
    const std::size_t at = first_pixel(label_of(i));
    float* sh = set.sh.data() + stride * (first + i) + 3;
    for (std::size_t k = 0; k < coefficients; ++k) {
      for (std::size_t c = 0; c < 3; ++c) sh[3 * k + c] = book[centroids_->pixel(at + k)[c]];
    }
  });
  for (std::size_t i = 0; entries < 256 && i < count_; ++i) {
    const float* sh = set.sh.data() + stride * (first + i) + 3;
    if (std::any_of(sh, sh + 3 * coefficients, [](float v) { return std::isnan(v); })) {
      return invalid_file("{}: invalid index in palette entry {} (the codebook has {} entries)",
                          files_.label(palette.centroids), label_of(i), entries);
    }
  }
  return {};
}

}  // namespace stgs
