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
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfVersion.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string_view>
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

constexpr int kMaxChannels = 64;
constexpr std::uint64_t kMaxHeaderBytes = std::uint64_t{1} << 20;
// OpenEXR decodes one block at a time: its pixels, its compressed bytes, and what a method of
// compression needs.
constexpr std::uint64_t kBlockCopies = 4;
constexpr std::uint64_t kTileBytes = 16;  // of the table of tiles, per tile
constexpr std::uint64_t kRowBytes = 8;    // of the table of rows, per row

// Checks that no attribute has more bytes than the file: OpenEXR allocates what they state. Files
// with several parts are refused: it reads the tables of all.
Status check_attributes(const ByteSource& source) {
  std::vector<std::uint8_t> bytes(std::min(source.size(), kMaxHeaderBytes));
  STGS_TRY(source.read(0, bytes));
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  std::size_t at = 8;  // after the magic number and the version
  const auto truncated = [&] {
    if (source.size() > kMaxHeaderBytes) {
      return unsupported("{}: its EXR header has more than {} bytes", source.name(),
                         kMaxHeaderBytes);
    }
    return invalid_file("{}: cannot read EXR: the header is truncated", source.name());
  };
  if (text.size() < at) return truncated();
  if (Imf::isMultiPart(bytes[4] | bytes[5] << 8)) {
    return unsupported("{}: has several EXR parts; write a file with one", source.name());
  }
  while (at < text.size() && text[at] != 0) {
    for (int i = 0; i < 2; ++i) at = std::min(text.find('\0', at), text.size() - 1) + 1;
    std::int32_t size = 0;
    if (text.size() - at < sizeof(size)) return truncated();
    std::memcpy(&size, text.data() + at, sizeof(size));
    at += sizeof(size);
    if (size < 0 || static_cast<std::size_t>(size) > text.size() - at) return truncated();
    at += static_cast<std::size_t>(size);
  }
  return at == text.size() ? truncated() : Status();
}

// Returns the number of rows that OpenEXR compresses together.
unsigned rows_per_block(Imf::Compression compression) {
  switch (compression) {
    case Imf::NO_COMPRESSION:
    case Imf::RLE_COMPRESSION:
    case Imf::ZIPS_COMPRESSION:
      return 1;
    case Imf::ZIP_COMPRESSION:
    case Imf::PXR24_COMPRESSION:
      return 16;
    case Imf::DWAB_COMPRESSION:
      return 256;
    default:
      return 32;
  }
}

// Returns the bytes that OpenEXR allocates to read an image of checked size.
Result<std::uint64_t> bytes_to_read(const Imf::Header& header, const std::string& path) {
  int channels = 0;
  std::uint64_t bytes_per_pixel = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c, ++channels) {
    bytes_per_pixel += c.channel().type == Imf::HALF ? 2 : 4;
  }
  if (channels > kMaxChannels) {
    return unsupported("{}: has {} channels (at most {}); write R, G and B only", path, channels,
                       kMaxChannels);
  }
  const Imath::Box2i window = header.dataWindow();
  const auto width = static_cast<std::uint64_t>(window.max.x - window.min.x + 1);
  const auto height = static_cast<std::uint64_t>(window.max.y - window.min.y + 1);
  // A file of rows may have a description of tiles that OpenEXR ignores.
  const std::uint64_t block = width * rows_per_block(header.compression()) * bytes_per_pixel;
  if (!header.hasTileDescription()) return kBlockCopies * block + kRowBytes * height;
  const Imf::TileDescription& tile = header.tileDescription();
  STGS_TRY(encoder::check_image_size(tile.xSize, tile.ySize, path));
  const std::uint64_t tile_bytes = std::uint64_t{tile.xSize} * tile.ySize * bytes_per_pixel;
  // Smaller levels have at most three times as many. OpenEXR keeps a row of tiles as floats.
  const std::uint64_t tiles = 4 * (width / tile.xSize + 1) * (height / tile.ySize + 1);
  return kBlockCopies * std::max(block, tile_bytes) + kTileBytes * tiles +
         sizeof(float) * 3 * width * tile.ySize;
}

// Checks the header before OpenEXR allocates memory for the pixels.
Status check_header(const ByteSource& source, const std::string& path, std::uint64_t max_memory) {
  STGS_TRY(check_attributes(source));
  SourceReader stream(source);
  std::uint8_t start[8] = {};
  STGS_TRY(source.read(0, start));
  stream.seekg(sizeof(start));
  Imf::Header header;
  int version = start[4] | start[5] << 8;
  header.readFrom(stream, version);
  const Imath::Box2i window = header.dataWindow();
  const std::int64_t width = std::int64_t{window.max.x} - window.min.x + 1,
                     height = std::int64_t{window.max.y} - window.min.y + 1;
  STGS_TRY(encoder::check_image_size(width, height, path));
  STGS_ASSIGN(const std::uint64_t bytes, bytes_to_read(header, path));
  if (bytes + std::uint64_t{12} * static_cast<std::uint64_t>(width * height) > max_memory) {
    return unsupported(
        "{}: {}x{} pixels and the decoding of their blocks exceed the limit of {} bytes; "
        "allow more memory",
        path, width, height, max_memory);
  }
  for (const char* name : {"R", "G", "B"}) {
    const Imf::Channel* channel = header.channels().findChannel(name);
    if (channel == nullptr || channel->xSampling != 1 || channel->ySampling != 1) {
      return unsupported("{}: no full-resolution channel {}", path, name);
    }
  }
  return {};
}

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
    STGS_TRY(check_header(*source, path, max_memory));
    SourceReader stream(*source);
    Imf::InputFile file(stream);
    const Imath::Box2i window = file.header().dataWindow();
    const int width = window.max.x - window.min.x + 1, height = window.max.y - window.min.y + 1;
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
