// SPDX-License-Identifier: Apache-2.0
#include "image_sink.h"

#include <filesystem>
#include <utility>

#include "output_folder.h"
#include "output_path.h"

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

// Writes FOLDER/CAMERA/NNNNNN.png.
class FolderSink final : public EightBitSink {
 public:
  FolderSink(const std::string& folder, const encoder::LogSink& log) : files_(folder, log) {}
  using EightBitSink::add;

  Status add(const ImageName& name, const encoder::Image8& image) override {
    const std::string file = name.camera.empty()
                                 ? fmt::format("{:06}.png", name.frame)
                                 : fmt::format("{}/{:06}.png", name.camera, name.frame);
    STGS_ASSIGN(const std::string path, files_.add(file));
    return write_png(path, image);
  }
  Status finish() override { return files_.commit(); }

 private:
  OutputFolder files_;
};

}  // namespace

Result<std::unique_ptr<ImageSink>> make_image_sink(const std::string& output, TimeBase time_base,
                                                   std::size_t cameras, std::size_t times,
                                                   Session& session) {
  using Sink = std::unique_ptr<ImageSink>;
  if (output == "null") return Sink(std::make_unique<NullSink>());
  std::error_code error;  // of a name that is too long, for example: claim_output() reports it
  if (!output.empty() && (output.back() == '/' || fs::is_directory(output, error))) {
    STGS_TRY(session.claim_folder(output));
    return Sink(std::make_unique<FolderSink>(output, session.log_sink()));
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
  if (output != "-") STGS_TRY(session.claim_output(output));
  if (end == ".png") return Sink(std::make_unique<PngSink>(output));
  if (end == ".exr") return Sink(std::make_unique<ExrSink>(output));
  if (end == ".y4m") return Sink(std::make_unique<VideoSink>(make_y4m_writer(output, time_base)));
  STGS_ASSIGN(auto writer, make_mp4_writer(output, time_base, session.log_sink()));
  return Sink(std::make_unique<VideoSink>(std::move(writer)));
}

}  // namespace stgs::tools
