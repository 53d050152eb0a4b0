// SPDX-License-Identifier: Apache-2.0
// Reading PLY files with one vertex per Gaussian and the properties of 3DGS (Kerbl et al. 2023).
#include <algorithm>
#include <array>
#include <charconv>
#include <limits>

#include "interchange/ply.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::size_t kBlockBytes = std::size_t{8} << 20;
constexpr std::size_t kMaxCoefficients = 16;

// For each component of a primitive, the index of its vertex property.
struct PlyFields {
  int sh_degree = 0;
  std::array<std::size_t, 3> position, log_scale;
  std::array<std::size_t, 4> rotation;
  std::size_t opacity = 0;
  std::array<std::size_t, 3 * kMaxCoefficients> sh;  // coefficient, then channel
};

std::uint64_t count_rest(const PlyElement& vertex) {
  std::uint64_t count = 0;
  while (vertex.find(fmt::format("f_rest_{}", count)) != nullptr) ++count;
  return count;
}

class FieldFinder {
 public:
  FieldFinder(const std::string& file, const PlyElement& vertex) : file_(file), vertex_(vertex) {}

  Result<PlyFields> find(ConversionNotes* notes) {
    PlyFields fields;
    const char* axes[] = {"x", "y", "z"};
    for (std::size_t c = 0; c < 3; ++c) STGS_TRY(find_one(axes[c], fields.position[c]));
    for (std::size_t c = 0; c < 3; ++c) {
      STGS_TRY(find_one(fmt::format("scale_{}", c), fields.log_scale[c]));
      STGS_TRY(find_one(fmt::format("f_dc_{}", c), fields.sh[c]));
    }
    for (std::size_t c = 0; c < 4; ++c) {
      STGS_TRY(find_one(fmt::format("rot_{}", c), fields.rotation[c]));
    }
    STGS_TRY(find_one("opacity", fields.opacity));
    STGS_TRY(find_rest(fields, notes));
    return fields;
  }

 private:
  Status find_one(const std::string& name, std::size_t& index) const {
    const PlyProperty* property = vertex_.find(name);
    if (property == nullptr) {
      return unsupported("{}: not a 3DGS PLY (vertices lack the property '{}')", file_, name);
    }
    index = static_cast<std::size_t>(property - vertex_.properties.data());
    return {};
  }

  // f_rest has all coefficients of red, then green, then blue.
  Status find_rest(PlyFields& fields, ConversionNotes* notes) const {
    const std::uint64_t count = count_rest(vertex_);
    const std::uint64_t per_channel = count / 3;
    if (count % 3 != 0 || sh_degree_of(per_channel) < 0) {
      return unsupported(
          "{}: wrong number of 'f_rest' properties (expected 0, 9, 24, 45 or 72, got "
          "{})",
          file_, count);
    }
    fields.sh_degree = std::min(sh_degree_of(per_channel), 3);
    if (sh_degree_of(per_channel) > 3) note(notes, "dropped SH of degree 4");
    const auto coefficients =
        static_cast<std::uint64_t>((fields.sh_degree + 1) * (fields.sh_degree + 1));
    for (std::uint64_t k = 1; k < coefficients; ++k) {
      for (std::uint64_t c = 0; c < 3; ++c) {
        STGS_TRY(find_one(fmt::format("f_rest_{}", c * per_channel + k - 1), fields.sh[3 * k + c]));
      }
    }
    return {};
  }

  const std::string& file_;
  const PlyElement& vertex_;
};

// Stores primitive i. value(index) returns a property of its record.
template <typename Value>
void store(const PlyFields& fields, std::size_t i, Gaussians4D& set, const Value& value) {
  const auto sh = static_cast<std::size_t>(3 * set.sh_coefficients());
  for (std::size_t c = 0; c < 3; ++c) set.position[3 * i + c] = value(fields.position[c]);
  for (std::size_t c = 0; c < 3; ++c) set.log_scale[3 * i + c] = value(fields.log_scale[c]);
  for (std::size_t c = 0; c < 4; ++c) set.rotation[4 * i + c] = value(fields.rotation[c]);
  set.opacity_logit[i] = value(fields.opacity);
  for (std::size_t k = 0; k < sh; ++k) set.sh[i * sh + k] = value(fields.sh[k]);
}

Status read_binary(const ByteSource& source, const PlyElement& vertex, const PlyFields& fields,
                   ImportMemory& memory, Gaussians4D& set) {
  const auto stride = static_cast<std::size_t>(vertex.stride);
  const std::size_t block_size = std::max<std::size_t>(1, kBlockBytes / stride);
  const std::size_t block_bytes = std::min(block_size, set.size()) * stride;
  STGS_ASSIGN(const Lease lease, memory.take(block_bytes, "the vertices being read"));
  std::vector<std::uint8_t> bytes(block_bytes);
  for (std::size_t begin = 0; begin < set.size(); begin += block_size) {
    const std::size_t count = std::min(block_size, set.size() - begin);
    STGS_TRY(source.read(vertex.offset + begin * stride, {bytes.data(), count * stride}));
    parallel_blocks(
        std::size_t{0}, count, kPrimitivesPerTask, [&](std::size_t first, std::size_t last) {
          for (std::size_t i = first; i < last; ++i) {
            const std::uint8_t* record = bytes.data() + i * stride;
            store(fields, begin + i, set,
                  [&](std::size_t p) { return ply_float(record, vertex.properties[p]); });
          }
        });
  }
  return {};
}

// The numbers of an ASCII body, separated by white space.
class NumberReader {
 public:
  explicit NumberReader(std::string_view text) : at_(text.data()), end_(at_ + text.size()) {}

  bool next(float& value) {
    while (at_ < end_ && (*at_ == ' ' || *at_ == '\n' || *at_ == '\r' || *at_ == '\t')) ++at_;
    if (end_ - at_ > 1 && *at_ == '+' && at_[1] != '-') ++at_;
    double wide = 0;
    const auto [after, error] = std::from_chars(at_, end_, wide);
    // Underflow gives 0. Overflow gives NaN, so that the primitive is dropped with a note.
    if (error == std::errc::result_out_of_range) {
      const bool small = std::find(at_ + 1, after, '-') != after;
      wide = small ? 0.0 : std::numeric_limits<double>::quiet_NaN();
    } else if (error != std::errc()) {
      return false;
    }
    value = static_cast<float>(wide);
    at_ = after;
    return true;
  }

 private:
  const char *at_, *end_;
};

// `skipped`: count of numbers before the vertices.
Status read_ascii(const std::string& file, std::string_view body, std::uint64_t skipped,
                  const PlyElement& vertex, const PlyFields& fields, Gaussians4D& set) {
  NumberReader numbers(body);
  float ignored = 0;
  for (std::uint64_t i = 0; i < skipped; ++i) {
    if (!numbers.next(ignored)) return invalid_file("{}: truncated before the vertices", file);
  }
  std::vector<float> record(vertex.properties.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    for (float& value : record) {
      if (!numbers.next(value)) {
        return invalid_file("{}: vertex {} of {} is incomplete or not numeric", file, i,
                            set.size());
      }
    }
    store(fields, i, set, [&](std::size_t p) { return record[p]; });
  }
  return {};
}

// Reads the complete body of an ASCII file and counts the numbers before the vertices. A number
// takes at least two bytes including its separator, so that counts are checked before allocating.
Result<Charged<std::string>> ascii_body(const ByteSource& source, const PlyHeader& header,
                                        const PlyElement& vertex, ImportMemory& memory,
                                        std::uint64_t& skipped) {
  const std::uint64_t bytes = source.size() - header.bytes;
  std::uint64_t left = bytes / 2 + 1;
  for (const PlyElement& element : header.elements) {
    const std::uint64_t width = element.properties.size();
    if (element.has_lists || (width > 0 && element.count > left / width)) {
      return invalid_file("{}: {} records '{}' do not fit in {} bytes", source.name(),
                          element.count, element.name, bytes);
    }
    left -= element.count * width;
    if (&element == &vertex) break;
    skipped += element.count * width;
  }
  Charged<std::string> body;
  STGS_ASSIGN(body.lease, memory.take(bytes, "the bytes of the text"));
  body.value.resize(static_cast<std::size_t>(bytes));
  STGS_TRY(source.read(header.bytes,
                       {reinterpret_cast<std::uint8_t*>(body.value.data()), body.value.size()}));
  return body;
}

}  // namespace

int sh_degree_of(std::uint64_t rest_coefficients) {
  for (int degree = 0; degree <= 4; ++degree) {
    if (rest_coefficients + 1 == static_cast<std::uint64_t>((degree + 1) * (degree + 1))) {
      return degree;
    }
  }
  return -1;
}

Result<Charged<Gaussians4D>> read_ply_vertices(const ByteSource& source, const PlyHeader& header,
                                               ImportMemory& memory, ConversionNotes* notes) {
  const PlyElement* vertex = header.find("vertex");
  if (vertex == nullptr) return unsupported("{}: PLY without an element 'vertex'", source.name());
  if (vertex->has_lists || !vertex->offset_known) {
    return unsupported("{}: list properties in or before the vertices", source.name());
  }
  STGS_ASSIGN(const PlyFields fields, FieldFinder(source.name(), *vertex).find(notes));
  std::uint64_t skipped = 0;
  Charged<std::string> body;
  if (header.ascii) {
    STGS_ASSIGN(body, ascii_body(source, header, *vertex, memory, skipped));
  }
  Charged<Gaussians4D> out;
  out.value.sh_degree = fields.sh_degree;
  STGS_ASSIGN(out.lease, memory.take_set(vertex->count, fields.sh_degree));
  out.value.resize(static_cast<std::size_t>(vertex->count));
  STGS_TRY(header.ascii ? read_ascii(source.name(), body.value, skipped, *vertex, fields, out.value)
                        : read_binary(source, *vertex, fields, memory, out.value));
  return out;
}

Result<Charged<Scene>> read_ply_scene(const ByteSource& source, ImportMemory& memory,
                                      ConversionNotes* notes) {
  STGS_ASSIGN(const PlyHeader header, read_ply_header(source));
  STGS_ASSIGN(Charged<Gaussians4D> set, is_packed_ply(header)
                                            ? read_packed_ply(source, header, memory)
                                            : read_ply_vertices(source, header, memory, notes));
  return Charged<Scene>{finish_import(std::move(set.value), notes), std::move(set.lease)};
}

Result<Scene> read_ply(const ByteSource& source, const ReadLimits& limits, ConversionNotes* notes) {
  ImportMemory memory(limits, source.name());
  STGS_ASSIGN(Charged<Scene> scene, read_ply_scene(source, memory, notes));
  return std::move(scene.value);
}

}  // namespace stgs
