// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/ply_header.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <limits>
#include <span>

namespace stgs {
namespace {

static_assert(std::endian::native == std::endian::little, "PLY values are copied without swapping");

constexpr std::uint64_t kMaxHeaderBytes = 256 * 1024;
constexpr std::size_t kMaxProperties = 4096;

struct TypeName {
  std::string_view name, alias;
  PlyType type;
  std::uint64_t bytes;
};
constexpr std::array<TypeName, 8> kTypes = {{{"char", "int8", PlyType::kInt8, 1},
                                             {"uchar", "uint8", PlyType::kUint8, 1},
                                             {"short", "int16", PlyType::kInt16, 2},
                                             {"ushort", "uint16", PlyType::kUint16, 2},
                                             {"int", "int32", PlyType::kInt32, 4},
                                             {"uint", "uint32", PlyType::kUint32, 4},
                                             {"float", "float32", PlyType::kFloat32, 4},
                                             {"double", "float64", PlyType::kFloat64, 8}}};

// Removes and returns the first word of a line; "" at its end.
std::string_view next_word(std::string_view& line) {
  const std::size_t begin = std::min(line.find_first_not_of(" \t"), line.size());
  line.remove_prefix(begin);
  const std::string_view word = line.substr(0, line.find_first_of(" \t"));
  line.remove_prefix(word.size());
  return word;
}

// Removes the first line of the text and returns it without its end. Returns false if no line end
// is left.
bool next_line(std::string_view& text, std::string_view& line) {
  const std::size_t end = text.find('\n');
  if (end == std::string_view::npos) return false;
  line = text.substr(0, end);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  text.remove_prefix(end + 1);
  return true;
}

class HeaderParser {
 public:
  HeaderParser(const std::string& file, std::string_view text) : file_(file), text_(text) {}

  Result<PlyHeader> parse() {
    const std::size_t size = text_.size();
    std::string_view line;
    if (!next_line(text_, line) || line != "ply") {
      return invalid_file("{}: not a PLY file (first line is not 'ply')", file_);
    }
    while (next_line(text_, line)) {
      ++line_number_;
      const std::string_view keyword = next_word(line);
      if (keyword == "end_header") {
        if (!has_format_) return invalid_file("{}: PLY header has no format line", file_);
        header_.bytes = size - text_.size();
        return std::move(header_);
      }
      STGS_TRY(take(keyword, line));
    }
    return invalid_file(
        "{}: PLY header is truncated (no 'end_header' within {} bytes); copy "
        "or download it again",
        file_, size);
  }

 private:
  Status take(std::string_view keyword, std::string_view rest) {
    if (keyword == "format") return format(next_word(rest));
    if (keyword == "element") return element(rest);
    if (keyword == "property") return property(rest);
    if (keyword == "comment") {
      rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size()));
      header_.comments.emplace_back(rest);
      return {};
    }
    if (keyword.empty() || keyword == "obj_info") return {};
    return invalid_file("{}: PLY header, line {}: unknown keyword '{}'", file_, line_number_,
                        keyword);
  }

  Status format(std::string_view name) {
    header_.ascii = name == "ascii";
    has_format_ = true;
    if (header_.ascii || name == "binary_little_endian") return {};
    return unsupported("{}: unsupported PLY format '{}'; use binary_little_endian", file_, name);
  }

  Status element(std::string_view rest) {
    PlyElement element;
    element.name = next_word(rest);
    const std::string_view count = next_word(rest);
    const auto [end, error] =
        std::from_chars(count.data(), count.data() + count.size(), element.count);
    if (element.name.empty() || error != std::errc() || end != count.data() + count.size()) {
      return invalid_file("{}: PLY header, line {}: element without a name and a count", file_,
                          line_number_);
    }
    if (header_.find(element.name) != nullptr) {
      return invalid_file("{}: PLY header, line {}: duplicate element '{}'", file_, line_number_,
                          element.name);
    }
    header_.elements.push_back(std::move(element));
    return {};
  }

  Status property(std::string_view rest) {
    if (header_.elements.empty()) {
      return invalid_file("{}: PLY header, line {}: property before the first element", file_,
                          line_number_);
    }
    if (++properties_ > kMaxProperties) {
      return invalid_file("{}: PLY header has more than {} properties", file_, kMaxProperties);
    }
    PlyElement& element = header_.elements.back();
    const std::string_view type = next_word(rest);
    if (type == "list") {
      element.has_lists = true;
      return {};
    }
    const std::string_view name = next_word(rest);
    const auto known = std::find_if(kTypes.begin(), kTypes.end(), [type](const TypeName& t) {
      return t.name == type || t.alias == type;
    });
    if (known == kTypes.end() || name.empty()) {
      return invalid_file("{}: PLY header, line {}: expected a scalar type and a name, got '{}'",
                          file_, line_number_, type);
    }
    if (element.find(name) != nullptr) {
      return invalid_file("{}: PLY header, line {}: duplicate property '{}'", file_, line_number_,
                          name);
    }
    element.properties.push_back({std::string(name), known->type, element.stride});
    element.stride += known->bytes;
    return {};
  }

  const std::string& file_;
  std::string_view text_;
  PlyHeader header_;
  int line_number_ = 1;
  std::size_t properties_ = 0;
  bool has_format_ = false;
};

// Sets the offset of each element of a binary file, up to the first one with lists.
Status locate_elements(const ByteSource& source, PlyHeader& header) {
  std::uint64_t at = header.bytes;
  bool known = true;
  for (PlyElement& element : header.elements) {
    element.offset = at;
    element.offset_known = known;
    known = known && !element.has_lists;
    if (!known || element.stride == 0) continue;
    const std::uint64_t left = source.size() - at;
    if (element.count > left / element.stride) {
      return invalid_file(
          "{}: the file is truncated ({} records '{}' of {} bytes stated, {} bytes left at byte "
          "{}); copy or download it again",
          source.name(), element.count, element.name, element.stride, left, at);
    }
    at += element.count * element.stride;
  }
  return {};
}

}  // namespace

const PlyProperty* PlyElement::find(std::string_view property) const {
  const auto found = std::find_if(properties.begin(), properties.end(),
                                  [&](const PlyProperty& p) { return p.name == property; });
  return found == properties.end() ? nullptr : &*found;
}

const PlyElement* PlyHeader::find(std::string_view element) const {
  const auto found = std::find_if(elements.begin(), elements.end(),
                                  [&](const PlyElement& e) { return e.name == element; });
  return found == elements.end() ? nullptr : &*found;
}

Result<PlyHeader> read_ply_header(const ByteSource& source) {
  std::string head(static_cast<std::size_t>(std::min(source.size(), kMaxHeaderBytes)), '\0');
  STGS_TRY(source.read(0, {reinterpret_cast<std::uint8_t*>(head.data()), head.size()}));
  STGS_ASSIGN(PlyHeader header, HeaderParser(source.name(), head).parse());
  if (!header.ascii) STGS_TRY(locate_elements(source, header));
  return header;
}

}  // namespace stgs
