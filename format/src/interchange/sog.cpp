// SPDX-License-Identifier: Apache-2.0
// Reading SOG version 2, as specified by PlayCanvas ("The SOG Format", developer.playcanvas.com): a
// meta.json, and images whose pixel i belongs to splat i. Axes: as 3DGS PLY.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>

#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "interchange/named_files.h"
#include "interchange/sog_models.h"
#include "interchange/webp_image.h"
#include "stgs/format/interchange_formats.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxMetaBytes = 16 << 20;
constexpr std::size_t kCodebook = 256;        // entries, one per byte value
constexpr std::size_t kPaletteRow = 64;       // palette entries per row of shN_centroids
constexpr std::size_t kMaxPalette = 1 << 16;  // entries, addressed by labels of 16 bits
constexpr std::size_t kBlock = 1 << 14;       // splats per task

using Codebook = std::array<float, kCodebook>;

// The palette of the SH above degree 0.
struct Palette {
  int bands = 0;            // 1..3
  std::size_t entries = 0;  // 1..65536
  Codebook codebook;
  std::string centroids, labels;  // file names

  std::size_t coefficients() const {
    return static_cast<std::size_t>((bands + 1) * (bands + 1) - 1);
  }
};

struct Meta {
  std::size_t count = 0;
  std::array<double, 3> mins{}, maxs{};  // log-mapped positions
  Codebook scales, sh0;
  std::string means_low, means_high, scales_file, quats_file, sh0_file;
  std::optional<Palette> palette;
};

// Returns the file names of a property.
Result<std::vector<std::string>> file_names(const json& property, std::size_t count,
                                            const std::string& label) {
  const json& files = member(property, "files");
  if (!files.is_array() || files.size() != count) {
    return invalid_file("{}.files: expected a list of {} file names", label, count);
  }
  std::vector<std::string> out;
  for (const json& name : files) {
    if (!name.is_string()) return invalid_file("{}.files: expected file names", label);
    out.push_back(name.get<std::string>());
  }
  return out;
}

Result<Codebook> codebook_of(const json& property, const std::string& label) {
  json list = member(property, "codebook");
  // Early writers left entry 0 null. It lies on the line through entries 1 and 255.
  if (list.is_array() && list.size() == kCodebook && list[0].is_null() && list[1].is_number() &&
      list[255].is_number()) {
    const double second = list[1].get<double>();
    list[0] = second + (second - list[255].get<double>()) / 255;
  }
  STGS_ASSIGN(const std::vector<double> values, number_list(list, kCodebook, label + ".codebook"));
  Codebook out;
  std::transform(values.begin(), values.end(), out.begin(),
                 [](double v) { return static_cast<float>(v); });
  return out;
}

Result<Palette> palette_of(const json& property, const std::string& label) {
  Palette palette;
  const json &bands = member(property, "bands"), &entries = member(property, "count");
  if (!bands.is_number_unsigned() || bands.get<std::uint64_t>() < 1 ||
      bands.get<std::uint64_t>() > 3) {
    return invalid_file("{}.bands: expected 1, 2 or 3", label);
  }
  if (!entries.is_number_unsigned() || entries.get<std::uint64_t>() < 1 ||
      entries.get<std::uint64_t>() > kMaxPalette) {
    return invalid_file("{}.count: expected 1 to {}", label, kMaxPalette);
  }
  palette.bands = static_cast<int>(bands.get<std::uint64_t>());
  palette.entries = static_cast<std::size_t>(entries.get<std::uint64_t>());
  STGS_ASSIGN(palette.codebook, codebook_of(property, label));
  STGS_ASSIGN(const std::vector<std::string> names, file_names(property, 2, label));
  palette.centroids = names[0];
  palette.labels = names[1];
  return palette;
}

Result<Meta> parse_meta(std::span<const std::uint8_t> text, const std::string& label,
                        const ReadLimits& limits) {
  STGS_ASSIGN(const json root, parse_json(text, label));
  const json &version = member(root, "version"), &count = member(root, "count");
  if (version.is_null() && root.is_object() && root.contains("means")) {
    return unsupported("{}: unsupported SOG version (expected 2, got 1)", label);
  }
  if (!version.is_number_unsigned()) {
    return invalid_file("{}: not the description of a SOG model (no version)", label);
  }
  if (version != 2) {
    return unsupported("{}: unsupported SOG version (expected 2, got {})", label, version.dump());
  }
  if (!count.is_number_unsigned()) return invalid_file("{}: count: expected a number >= 0", label);
  if (count.get<std::uint64_t>() > limits.max_primitives) {
    return unsupported("{}: too many splats (at most {} allowed, got {})", label,
                       limits.max_primitives, count.get<std::uint64_t>());
  }
  Meta meta;
  meta.count = static_cast<std::size_t>(count.get<std::uint64_t>());
  const json& means = member(root, "means");
  STGS_ASSIGN(const auto mins, number_list(member(means, "mins"), 3, label + ": means.mins"));
  STGS_ASSIGN(const auto maxs, number_list(member(means, "maxs"), 3, label + ": means.maxs"));
  std::copy_n(mins.begin(), 3, meta.mins.begin());
  std::copy_n(maxs.begin(), 3, meta.maxs.begin());
  STGS_ASSIGN(const auto mean_files, file_names(means, 2, label + ": means"));
  meta.means_low = mean_files[0];
  meta.means_high = mean_files[1];
  const json &scales = member(root, "scales"), &sh0 = member(root, "sh0");
  STGS_ASSIGN(meta.scales, codebook_of(scales, label + ": scales"));
  STGS_ASSIGN(meta.sh0, codebook_of(sh0, label + ": sh0"));
  STGS_ASSIGN(const auto scale_files, file_names(scales, 1, label + ": scales"));
  STGS_ASSIGN(const auto quat_files, file_names(member(root, "quats"), 1, label + ": quats"));
  STGS_ASSIGN(const auto sh0_files, file_names(sh0, 1, label + ": sh0"));
  meta.scales_file = scale_files[0];
  meta.quats_file = quat_files[0];
  meta.sh0_file = sh0_files[0];
  if (const json& sh = member(root, "shN"); !sh.is_null()) {
    STGS_ASSIGN(meta.palette, palette_of(sh, label + ": shN"));
  }
  return meta;
}

// Reads one SOG model into a set of primitives.
class SogReader {
 public:
  SogReader(NamedFiles& files, const ReadLimits& limits) : files_(files), limits_(limits) {}

  // Reads the description. Allocates no memory for splats yet.
  Status open(const std::string& meta_name) {
    STGS_ASSIGN(const std::vector<std::uint8_t> text, files_.read(meta_name, kMaxMetaBytes));
    STGS_ASSIGN(meta_, parse_meta(text, files_.label(meta_name), limits_));
    return {};
  }

  std::size_t count() const { return meta_.count; }
  int sh_degree() const { return meta_.palette ? meta_.palette->bands : 0; }

  // Sets primitives [first, first + count()) of the set, which exist and are zero.
  Status read_into(Gaussians4D& set, std::size_t first) {
    STGS_TRY(read_means(set, first));
    STGS_TRY(read_scales(set, first));
    STGS_TRY(read_rotations(set, first));
    STGS_TRY(read_colours(set, first));
    return meta_.palette ? read_sh(set, first) : Status();
  }

 private:
  Result<ImageRgba> decode(const std::string& name) {
    STGS_ASSIGN(const std::vector<std::uint8_t> bytes, files_.read(name, limits_.max_memory));
    return decode_lossless_webp(bytes, files_.label(name), limits_.max_memory);
  }

  // Reads an image with a pixel for each splat. All such images of a model have the same size.
  Result<ImageRgba> splat_image(const std::string& name) {
    STGS_ASSIGN(ImageRgba image, decode(name));
    if (image.size() < meta_.count) {
      return invalid_file("{}: image too small ({} x {} pixels for {} splats)", files_.label(name),
                          image.width, image.height, meta_.count);
    }
    if (width_ == 0) {
      width_ = image.width;
      height_ = image.height;
    } else if (image.width != width_ || image.height != height_) {
      return invalid_file("{}: image size differs within the model (expected {} x {}, got {} x {})",
                          files_.label(name), width_, height_, image.width, image.height);
    }
    return image;
  }

  // Calls body(i) for each splat of the model.
  template <typename Body>
  void each(const Body& body) const {
    parallel_blocks(std::size_t{0}, meta_.count, kBlock, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) body(i);
    });
  }

  // 16 bits per axis between the bounds of sign(x) ln(|x| + 1).
  Status read_means(Gaussians4D& set, std::size_t first) {
    STGS_ASSIGN(const ImageRgba low, splat_image(meta_.means_low));
    STGS_ASSIGN(const ImageRgba high, splat_image(meta_.means_high));
    for (std::size_t c = 0; c < 3; ++c) {
      const double mins = meta_.mins[c], range = meta_.maxs[c] - mins;
      std::vector<float> value(1 << 16);
      for (std::size_t q = 0; q < value.size(); ++q) {
        const double mapped = mins + range * (static_cast<double>(q) / 65535);
        value[q] = static_cast<float>(std::copysign(std::expm1(std::abs(mapped)), mapped));
      }
      if (!std::isfinite(value.front()) || !std::isfinite(value.back())) {
        return invalid_file("{}: means.mins[{}] or means.maxs[{}] exceed the range of binary32",
                            files_.label("meta.json"), c, c);
      }
      each([&](std::size_t i) {
        set.position[3 * (first + i) + c] =
            value[low.pixel(i)[c] | std::size_t{high.pixel(i)[c]} << 8];
      });
    }
    return {};
  }

  Status read_scales(Gaussians4D& set, std::size_t first) {
    STGS_ASSIGN(const ImageRgba image, splat_image(meta_.scales_file));
    each([&](std::size_t i) {
      for (std::size_t c = 0; c < 3; ++c) {
        set.log_scale[3 * (first + i) + c] = meta_.scales[image.pixel(i)[c]];
      }
    });
    return {};
  }

  // Alpha gives the index of the largest of w x y z; the others follow in order, each within
  // +-1/sqrt(2).
  Status read_rotations(Gaussians4D& set, std::size_t first) {
    STGS_ASSIGN(const ImageRgba image, splat_image(meta_.quats_file));
    for (std::size_t i = 0; i < meta_.count; ++i) {
      if (image.pixel(i)[3] < 252) {
        return invalid_file("{}: invalid alpha of splat {} (expected 252 to 255, got {})",
                            files_.label(meta_.quats_file), i, image.pixel(i)[3]);
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

  Status read_colours(Gaussians4D& set, std::size_t first) {
    STGS_ASSIGN(const ImageRgba image, splat_image(meta_.sh0_file));
    const std::size_t stride = 3 * static_cast<std::size_t>(set.sh_coefficients());
    std::array<float, 256> logit;
    for (int a = 0; a < 256; ++a) logit[static_cast<std::size_t>(a)] = logit_of_byte(a);
    each([&](std::size_t i) {
      const std::uint8_t* pixel = image.pixel(i);
      for (std::size_t c = 0; c < 3; ++c) set.sh[stride * (first + i) + c] = meta_.sh0[pixel[c]];
      set.opacity_logit[first + i] = logit[pixel[3]];
    });
    return {};
  }

  // Each splat has a label of 16 bits, the index of a palette entry, whose coefficients are
  // adjacent in the image of centroids.
  Status read_sh(Gaussians4D& set, std::size_t first) {
    const Palette& palette = *meta_.palette;
    const std::size_t coefficients = palette.coefficients();
    STGS_ASSIGN(const ImageRgba centroids, decode(palette.centroids));
    const auto width = static_cast<std::size_t>(centroids.width);
    const auto height = static_cast<std::size_t>(centroids.height);
    if (width != kPaletteRow * coefficients || height * kPaletteRow < palette.entries) {
      return invalid_file("{}: wrong image size ({} x {} pixels for {} entries of {} coefficients)",
                          files_.label(palette.centroids), width, height, palette.entries,
                          coefficients);
    }
    STGS_ASSIGN(const ImageRgba labels, splat_image(palette.labels));
    const auto label_of = [&](std::size_t i) {
      return labels.pixel(i)[0] | std::size_t{labels.pixel(i)[1]} << 8;
    };
    for (std::size_t i = 0; i < meta_.count; ++i) {
      if (label_of(i) >= palette.entries) {
        return invalid_file("{}: invalid label {} of splat {} (the palette has {} entries)",
                            files_.label(palette.labels), label_of(i), i, palette.entries);
      }
    }
    const std::size_t stride = 3 * static_cast<std::size_t>(set.sh_coefficients());
    each([&](std::size_t i) {
      const std::size_t entry = label_of(i);
      const std::size_t at = entry / kPaletteRow * width + entry % kPaletteRow * coefficients;
      float* sh = set.sh.data() + stride * (first + i) + 3;
      for (std::size_t k = 0; k < coefficients; ++k) {
        for (std::size_t c = 0; c < 3; ++c) {
          sh[3 * k + c] = palette.codebook[centroids.pixel(at + k)[c]];
        }
      }
    });
    return {};
  }

  NamedFiles& files_;
  const ReadLimits& limits_;
  Meta meta_;
  int width_ = 0, height_ = 0;  // of each image with a pixel per splat
};

}  // namespace

Result<Scene> read_sog(const std::string& path, const ReadLimits& limits, ConversionNotes* notes) {
  STGS_ASSIGN(const std::vector<std::string> models, sog_models(path));
  std::vector<std::unique_ptr<NamedFiles>> files;
  std::vector<SogReader> readers;
  readers.reserve(models.size());
  std::uint64_t total = 0;
  int degree = 0;
  for (const std::string& model : models) {
    const std::filesystem::path model_path(model);
    std::string meta_name = "meta.json";
    if (file_extension(model) != ".json") {
      STGS_ASSIGN(std::unique_ptr<NamedFiles> bundle, zip_files(model));
      files.push_back(std::move(bundle));
    } else {
      meta_name = model_path.filename().string();
      files.push_back(folder_files(model_path.parent_path().string()));
    }
    readers.emplace_back(*files.back(), limits);
    STGS_TRY(readers.back().open(meta_name));
    total += readers.back().count();
    degree = std::max(degree, readers.back().sh_degree());
  }
  STGS_TRY(check_import_size(path, total, degree, limits));
  Gaussians4D set;
  set.sh_degree = degree;
  set.resize(static_cast<std::size_t>(total));
  std::size_t first = 0;
  for (SogReader& reader : readers) {
    STGS_TRY(reader.read_into(set, first));
    first += reader.count();
  }
  return finish_import(std::move(set), notes);
}

}  // namespace stgs
