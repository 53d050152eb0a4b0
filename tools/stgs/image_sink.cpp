// SPDX-License-Identifier: Apache-2.0
#include "image_sink.h"

#include <filesystem>
#include <utility>
#include <vector>

#include "output_path.h"
#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;

// Accepts 8-bit images and converts float frames.
class EightBitSink : public ImageSink {
 public:
  using ImageSink::add;
  Status add(const ImageName& name, const FloatFrame& frame) final {
    return add(name, to_8bit(frame.colour));
  }
};

class NullSink final : public EightBitSink {
 public:
  using EightBitSink::add;
  Status add(const ImageName&, const encoder::Image8&) override { return {}; }
  Status finish() override { return {}; }
};

class PngSink final : public EightBitSink {
 public:
  explicit PngSink(std::string path) : path_(std::move(path)) {}
  using EightBitSink::add;
  Status add(const ImageName&, const encoder::Image8& image) override {
    return write_png(path_, image);
  }
  Status finish() override { return {}; }

 private:
  std::string path_;
};

class ExrSink final : public ImageSink {
 public:
  explicit ExrSink(std::string path) : path_(std::move(path)) {}
  bool wants_8bit() const override { return false; }
  Status add(const ImageName&, const encoder::Image8&) override {
    return usage_error("{}: EXR needs float frames", path_);
  }
  Status add(const ImageName&, const FloatFrame& frame) override { return write_exr(path_, frame); }
  Status finish() override { return {}; }

 private:
  std::string path_;
};

class VideoSink final : public EightBitSink {
 public:
  explicit VideoSink(std::unique_ptr<VideoWriter> writer) : writer_(std::move(writer)) {}
  using EightBitSink::add;
  Status add(const ImageName&, const encoder::Image8& image) override {
    return writer_->add(image);
  }
  Status finish() override { return writer_->finish(); }

 private:
  std::unique_ptr<VideoWriter> writer_;
};

// Writes FOLDER/CAMERA/NNNNNN.png, first to a temporary folder next to FOLDER. finish() renames
// that folder to FOLDER, or moves its files if FOLDER exists.
class FolderSink final : public EightBitSink {
 public:
  explicit FolderSink(const std::string& folder) : folder_(folder) {}
  using EightBitSink::add;

  Status add(const ImageName& name, const encoder::Image8& image) override {
    const std::string file = name.camera.empty()
                                 ? fmt::format("{:06}.png", name.frame)
                                 : fmt::format("{}/{:06}.png", name.camera, name.frame);
    if (made_.empty()) {
      STGS_TRY(work_.create(folder_));
      made_ = work_.path() + "/frames";
    }
    std::error_code error;
    fs::create_directories((fs::path(made_) / file).parent_path(), error);
    if (error) return io_error("{}: cannot create: {}", folder_, error.message());
    files_.push_back(file);
    return write_png(made_ + "/" + file, image);
  }

  Status finish() override {
    if (!fs::exists(folder_)) return rename_over(made_, folder_);
    for (const std::string& file : files_) {
      std::error_code error;
      fs::create_directories((fs::path(folder_) / file).parent_path(), error);
      if (error) return io_error("{}: cannot create: {}", folder_, error.message());
      STGS_TRY(rename_over(made_ + "/" + file, folder_ + "/" + file));
    }
    return {};
  }

 private:
  std::string folder_;
  WorkFolder work_;
  std::string made_;  // in the work folder; "" before the first image
  std::vector<std::string> files_;
};

std::string without_slashes(std::string path) {
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  return path;
}

}  // namespace

Result<std::unique_ptr<ImageSink>> make_image_sink(const std::string& output, TimeBase time_base,
                                                   std::size_t cameras, std::size_t times,
                                                   const encoder::LogSink& log) {
  using Sink = std::unique_ptr<ImageSink>;
  if (output == "null") return Sink(std::make_unique<NullSink>());
  if (!output.empty() && (output.back() == '/' || fs::is_directory(output))) {
    STGS_TRY(check_can_make_folder(output));
    const std::string folder = without_slashes(output);
    clear_leftovers(folder, log);
    return Sink(std::make_unique<FolderSink>(folder));
  }
  const std::string end = output == "-" ? ".y4m" : extension_of(output);
  const bool image = end == ".png" || end == ".exr", video = end == ".mp4" || end == ".y4m";
  if (!image && !video) {
    return usage_error(
        "'{}': unknown output format; use a name that ends in .png, .exr, .mp4, .y4m, or in / for "
        "a "
        "folder",
        output);
  }
  if (image && cameras * times != 1) {
    return usage_error("'{}' holds one image, not {}; write to a folder or a video", output,
                       cameras * times);
  }
  if (video && cameras != 1) {
    return usage_error("'{}' holds one camera, not {}; choose one with --which", output, cameras);
  }
  if (output != "-") STGS_TRY(prepare_output(output, log));
  if (end == ".png") return Sink(std::make_unique<PngSink>(output));
  if (end == ".exr") return Sink(std::make_unique<ExrSink>(output));
  if (end == ".y4m") return Sink(std::make_unique<VideoSink>(make_y4m_writer(output, time_base)));
  STGS_ASSIGN(auto writer, make_mp4_writer(output, time_base, log));
  return Sink(std::make_unique<VideoSink>(std::move(writer)));
}

}  // namespace stgs::tools
