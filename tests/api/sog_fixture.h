// SPDX-License-Identifier: Apache-2.0
// A small SOG model for tests: images and meta.json, written as a folder or a bundle.
#pragma once

#include <webp/encode.h>
#include <zip.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

namespace stgs::testing {

struct RgbaImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;
};

inline std::string encode_webp(const RgbaImage& image, bool lossless = true) {
  WebPConfig config;
  WebPConfigPreset(&config, WEBP_PRESET_DEFAULT, 90);
  config.lossless = lossless ? 1 : 0;
  config.exact = 1;  // keep colours where alpha is 0
  WebPPicture work;
  WebPPictureInit(&work);
  work.use_argb = 1;
  work.width = image.width;
  work.height = image.height;
  WebPPictureImportRGBA(&work, image.rgba.data(), 4 * image.width);
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  work.writer = WebPMemoryWrite;
  work.custom_ptr = &writer;
  std::string out;
  if (WebPEncode(&config, &work)) {
    out.assign(reinterpret_cast<const char*>(writer.mem), writer.size);
  }
  WebPPictureFree(&work);
  WebPMemoryWriterClear(&writer);
  return out;
}

// The content of a SOG model, which tests modify before they write it.
struct SogModel {
  nlohmann::json meta;
  std::map<std::string, RgbaImage> images;
  std::map<std::string, std::string> files;  // raw bytes, which replace the image of that name

  std::map<std::string, std::string> all_files() const {
    std::map<std::string, std::string> out;
    for (const auto& [name, image] : images) out[name] = encode_webp(image);
    out["meta.json"] = meta.dump();
    for (const auto& [name, bytes] : files) out[name] = bytes;
    return out;
  }
  void write_folder(const std::string& folder) const {
    std::filesystem::create_directories(folder);
    for (const auto& [name, bytes] : all_files()) {
      std::ofstream(folder + "/" + name, std::ios::binary) << bytes;
    }
  }
  void write_bundle(const std::string& path) const {
    std::filesystem::remove(path);
    const std::map<std::string, std::string> members = all_files();
    zip_t* archive = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
    for (const auto& [name, bytes] : members) {
      zip_source_t* source = zip_source_buffer(archive, bytes.data(), bytes.size(), 0);
      zip_file_add(archive, name.c_str(), source, ZIP_FL_OVERWRITE);
    }
    zip_close(archive);
  }
};

// `count` splats in images `width` pixels wide, with random bytes wherever every value is valid.
inline SogModel random_sog(int count, int bands, unsigned seed, int width = 8) {
  std::mt19937 random(seed);
  const int height = (count + width - 1) / width;
  const auto noise = [&](int w, int h, int alpha_from) {
    RgbaImage image{w, h, {}};
    for (int i = 0; i < w * h; ++i) {
      for (int c = 0; c < 3; ++c) image.rgba.push_back(static_cast<std::uint8_t>(random()));
      const int range = 256 - alpha_from;
      image.rgba.push_back(static_cast<std::uint8_t>(alpha_from + int(random() % range)));
    }
    return image;
  };
  const auto codebook = [](double from, double to) {
    std::vector<double> out;
    for (int i = 0; i < 256; ++i) out.push_back(from + (to - from) * i / 255);
    return out;
  };
  SogModel model;
  model.meta = {
      {"version", 2},
      {"count", count},
      {"means",
       {{"mins", {-2.5, -1.0, 0.0}}, {"maxs", {1.5, 1.0, 3.0}}, {"files", {"l.webp", "u.webp"}}}},
      {"scales", {{"codebook", codebook(-9, 0.5)}, {"files", {"scales.webp"}}}},
      {"quats", {{"files", {"quats.webp"}}}},
      {"sh0", {{"codebook", codebook(-2, 2)}, {"files", {"sh0.webp"}}}}};
  model.images = {{"l.webp", noise(width, height, 255)},
                  {"u.webp", noise(width, height, 255)},
                  {"scales.webp", noise(width, height, 255)},
                  {"quats.webp", noise(width, height, 252)},
                  {"sh0.webp", noise(width, height, 0)}};
  if (bands > 0) {
    constexpr int kEntries = 70;  // two rows of the palette
    const int coefficients = (bands + 1) * (bands + 1) - 1;
    model.meta["shN"] = {{"count", kEntries},
                         {"bands", bands},
                         {"codebook", codebook(-0.5, 0.5)},
                         {"files", {"centroids.webp", "labels.webp"}}};
    model.images["centroids.webp"] = noise(64 * coefficients, 2, 255);
    RgbaImage labels = noise(width, height, 255);
    for (int i = 0; i < width * height; ++i) {
      std::uint8_t& label = labels.rgba[4 * static_cast<std::size_t>(i)];
      label = static_cast<std::uint8_t>(label % kEntries);
      labels.rgba[4 * static_cast<std::size_t>(i) + 1] = 0;
    }
    model.images["labels.webp"] = labels;
  }
  return model;
}

}  // namespace stgs::testing
