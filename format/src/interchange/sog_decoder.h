// SPDX-License-Identifier: Apache-2.0
// Decoding of the images of a SOG model, whose pixel i belongs to splat i.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "interchange/named_files.h"
#include "interchange/sog_layout.h"
#include "interchange/webp_image.h"
#include "stgs/format/parallel.h"

namespace stgs {

// The image of the palette entries, which all groups of a model share.
Result<ImageRgba> sog_centroids(NamedFiles& files, const SogPalette& palette, ImportMemory& memory);

// Checks that the images of `count` splats in `folder` have as many pixels. Decodes nothing: call
// it before allocating splats.
Status check_sog_count(NamedFiles& files, const SogLayout& layout, std::size_t count,
                       const std::string& folder, ImportMemory& memory);

// Decodes `count` splats, which have images of their own. Images of splats are in `folder` of the
// set of files ("" or "name/"). The references must outlive the decoder. `centroids` may be null if
// the layout has no palette. One thread at a time.
class SogDecoder {
 public:
  SogDecoder(NamedFiles& files, const SogLayout& layout, const ImageRgba* centroids,
             ImportMemory& memory, std::size_t count, std::string folder = "");

  // Sets position, shape, opacity and colour of primitives [first, first + count) of the set, which
  // exist and are zero.
  Status read_into(Gaussians4D& set, std::size_t first);
  // Decodes an image with a pixel per splat. All of them have the same size.
  Result<ImageRgba> splat_image(const std::string& name);
  // Sets out[3 i + axis], i < count, to the values of a range: sign(x) (e^|x| - 1) for the stored
  // x. `label` names the property in messages.
  Status read_logarithms(const SogRange& range, const char* label, float* out);
  // Checks that the bytes of a channel of the splats are below `entries`.
  Status check_indices(const ImageRgba& image, std::size_t channel, std::size_t entries,
                       const std::string& name) const;

  // Calls body(i) for each splat, from several threads.
  template <typename Body>
  void each(const Body& body) const {
    constexpr std::size_t kBlock = 1 << 14;  // splats per task
    parallel_blocks(std::size_t{0}, count_, kBlock, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) body(i);
    });
  }

 private:
  std::string label(const std::string& name) const { return files_.label(folder_ + name); }
  Status read_scales(Gaussians4D& set, std::size_t first);
  Status read_rotations(Gaussians4D& set, std::size_t first);
  Status read_colours(Gaussians4D& set, std::size_t first);
  Status read_sh(Gaussians4D& set, std::size_t first);

  NamedFiles& files_;
  const SogLayout& layout_;
  const ImageRgba* centroids_;
  ImportMemory& memory_;
  std::size_t count_;
  std::string folder_;
  std::optional<ImageSize> size_;  // of each image with a pixel per splat
};

}  // namespace stgs
