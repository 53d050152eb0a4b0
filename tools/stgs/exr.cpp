// SPDX-License-Identifier: Apache-2.0
#include "exr.h"

#include "stgs/encoder/image_file.h"

#ifdef STGS_HAS_EXR
#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <utility>

#include "stgs/format/byte_source.h"
#endif

namespace stgs::tools {

#ifdef STGS_HAS_EXR
namespace {

// The sRGB transfer function and its inverse (IEC 61966-2-1), extended above 1.
float linear_of(float v) {
  return v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
}
float encoded_of(float v) {
  return v <= 0.0031308f ? v * 12.92f : 1.055f * std::pow(v, 1.0f / 2.4f) - 0.055f;
}

template <typename T>
Imf::Slice slice_over(Imf::PixelType type, const T* data, int width) {
  return Imf::Slice(type, reinterpret_cast<char*>(const_cast<T*>(data)), sizeof(T),
                    sizeof(T) * static_cast<std::size_t>(width));
}

// OpenEXR's own file streams do not report a full disk.
class BytesWriter final : public Imf::OStream {
 public:
  explicit BytesWriter(const std::string& name) : OStream(name.c_str()) {}
  void write(const char bytes[], int count) override {
    const std::size_t end = at_ + static_cast<std::size_t>(count);
    if (end > bytes_.size()) bytes_.resize(end);
    std::copy_n(bytes, count, bytes_.begin() + static_cast<std::ptrdiff_t>(at_));
    at_ = end;
  }
  std::uint64_t tellp() override { return at_; }
  void seekp(std::uint64_t at) override { at_ = static_cast<std::size_t>(at); }
  std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  std::vector<std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

class SourceReader final : public Imf::IStream {
 public:
  explicit SourceReader(const ByteSource& source)
      : IStream(source.name().c_str()), source_(source) {}
  // Returns whether more bytes follow.
  bool read(char bytes[], int count) override {
    const auto size = static_cast<std::size_t>(count);
    const Status status = source_.read(at_, {reinterpret_cast<std::uint8_t*>(bytes), size});
    if (!status.ok()) throw std::runtime_error(status.message());
    at_ += size;
    return at_ < source_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t at) override { at_ = at; }

 private:
  const ByteSource& source_;
  std::uint64_t at_ = 0;
};

}  // namespace

Result<std::vector<std::uint8_t>> encode_exr(const FloatFrame& frame, const std::string& name) {
  const int width = frame.colour.width, height = frame.colour.height;
  const std::size_t pixels = static_cast<std::size_t>(width) * height;
  static constexpr const char* kNames[] = {"R", "G", "B", "A"};
  try {
    std::vector<Imath::half> planes(pixels * 4);
    for (std::size_t i = 0; i < 3 * pixels; ++i) {
      planes[i] = Imath::half(linear_of(frame.colour.data[i]));
    }
    for (std::size_t i = 0; i < pixels; ++i) {
      planes[3 * pixels + i] = Imath::half(frame.alpha.data[i]);
    }
    Imf::Header header(width, height);
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::addComments(header,
                     "RGB: linear light, sRGB primaries, background blended in. A: opacity."
                     " Z: mean camera z in scene units, 0 where there is nothing.");
    Imf::FrameBuffer buffer;
    for (int c = 0; c < 4; ++c) {
      header.channels().insert(kNames[c], Imf::Channel(Imf::HALF));
      buffer.insert(kNames[c], slice_over(Imf::HALF, planes.data() + c * pixels, width));
    }
    header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
    buffer.insert("Z", slice_over(Imf::FLOAT, frame.depth.data.data(), width));
    BytesWriter bytes(name);
    {
      Imf::OutputFile file(bytes, header);
      file.setFrameBuffer(buffer);
      file.writePixels(height);
    }  // which completes the bytes
    return bytes.take();
  } catch (const std::exception& error) {
    return Status(code_of(error), fmt::format("{}: cannot encode as EXR: {}", name, error.what()));
  }
}

Result<Image> read_exr_file(const std::string& path, std::uint64_t max_memory) {
  try {
    STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
    SourceReader stream(*source);
    Imf::InputFile file(stream);
    const Imath::Box2i window = file.header().dataWindow();
    const int width = window.max.x - window.min.x + 1, height = window.max.y - window.min.y + 1;
    STGS_TRY(encoder::check_image_size(width, height, path));
    if (std::uint64_t{12} * static_cast<unsigned>(width) * static_cast<unsigned>(height) >
        max_memory) {
      return unsupported("{}: {}x{} pixels exceed the limit of {} bytes; allow more memory", path,
                         width, height, max_memory);
    }
    for (const char* name : {"R", "G", "B"}) {
      const Imf::Channel* channel = file.header().channels().findChannel(name);
      if (channel == nullptr || channel->xSampling != 1 || channel->ySampling != 1) {
        return unsupported("{}: no full-resolution channel {}", path, name);
      }
    }
    Image image;
    image.reshape(width, height, 3);
    Imf::FrameBuffer buffer;
    const char* names[] = {"R", "G", "B"};
    for (int c = 0; c < 3; ++c) {
      // OpenEXR addresses pixel (x, y) of the data window, which may not start at 0.
      const float* origin =
          image.plane(c) - window.min.x - static_cast<std::ptrdiff_t>(window.min.y) * width;
      buffer.insert(names[c], slice_over(Imf::FLOAT, origin, width));
    }
    file.setFrameBuffer(buffer);
    file.readPixels(window.min.y, window.max.y);
    for (float& v : image.data) v = encoded_of(v);
    return image;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    return invalid_file("{}: cannot read EXR: {}", path, error.what());
  }
}

#else

Result<std::vector<std::uint8_t>> encode_exr(const FloatFrame&, const std::string& name) {
  return not_built(
      "{}: this build has no EXR (OpenEXR was not found); write .png, or rebuild with "
      "libopenexr-dev",
      name);
}

Result<Image> read_exr_file(const std::string& path, std::uint64_t) {
  return not_built("{}: this build has no EXR (OpenEXR was not found); rebuild with libopenexr-dev",
                   path);
}

#endif

}  // namespace stgs::tools
