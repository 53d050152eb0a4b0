// SPDX-License-Identifier: Apache-2.0
#include "storage_nesting.h"

#include <algorithm>
#include <cctype>

namespace stgs::encoder {
namespace {

using std::string_view;

constexpr bool is_opening(char c) {
  return c == '[' || c == '{';
}

constexpr bool is_closing(char c) {
  return c == ']' || c == '}';
}

// Counts levels. Surplus closing brackets have no effect.
class Levels {
 public:
  void open() { greatest_ = std::max(greatest_, ++depth_); }
  void close() { depth_ = std::max(0, depth_ - 1); }
  void reset() { depth_ = 0; }
  int greatest() const { return greatest_; }

 private:
  int depth_ = 0, greatest_ = 0;
};

// Comments, escapes and base64 may hide the quotes that follow, so closing brackets after them do
// not count, and opening ones always do.
int json_nesting(string_view text) {
  Levels levels;
  bool in_string = false, is_certain = true;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    is_certain &= c != '\\' && !(c == '/' && !in_string) && !(c == '\n' && in_string) && c != '\0';
    is_certain &= c != '$' || text.substr(i, 8) != "$base64$";
    if (c == '"') in_string = !in_string;
    if (is_opening(c) && (!in_string || !is_certain)) levels.open();
    if (is_closing(c) && !in_string && is_certain) levels.close();
  }
  return levels.greatest();
}

// The parser rejects '<' and '>' in texts. Comments may contain any tag.
int xml_nesting(string_view text) {
  Levels levels;
  bool is_certain = true;
  for (std::size_t i = 0; i + 1 < text.size(); ++i) {
    const char c = text[i], next = text[i + 1];
    if (c == '<' && next == '!') is_certain = false;
    if (c == '<' && (std::isalnum(static_cast<unsigned char>(next)) != 0 || next == '_')) {
      levels.open();
    }
    const bool closes = (c == '<' && next == '/') || (c == '/' && next == '>');
    if (closes && is_certain) levels.close();
  }
  return levels.greatest();
}

// A line of YAML, without its end.
class Line {
 public:
  explicit Line(string_view text) : text_(text), column_(text.find_first_not_of(' ')) {}

  // Whether the line has only spaces and a comment.
  bool is_empty() const { return column_ == string_view::npos || text_[column_] == '#'; }
  // A line that begins in the first column ends all collections in brackets.
  bool ends_brackets() const { return !is_empty() && column_ == 0; }
  // Levels of collections by indentation that may be open at the end of the line.
  std::size_t indentation() const {
    std::size_t levels = column_;
    for (std::size_t i = column_; i < text_.size(); ++i) {
      const char next = i + 1 < text_.size() ? text_[i + 1] : ' ';
      const bool is_number = std::isdigit(static_cast<unsigned char>(next)) != 0 || next == '.';
      levels += text_[i] == ':' || (text_[i] == '-' && !is_number);
    }
    return levels;
  }
  // A key and a text end on their line, so the first character that is in neither.
  std::size_t first_certain() const {
    const std::size_t last = text_.find_last_of(":\"'");
    return last == string_view::npos ? 0 : last + 1;
  }
  // Comments, tags and a carriage return may hide the rest.
  std::size_t last_certain() const {
    return std::min(text_.find_first_of(string_view("#!\\\r\0", 5)), text_.size());
  }
  string_view text() const { return text_; }

 private:
  string_view text_;
  std::size_t column_;
};

struct YamlNesting {
  int brackets = 0;
  std::size_t indentation = 0;
};

YamlNesting yaml_nesting(string_view text) {
  Levels levels;
  YamlNesting nesting;
  bool is_certain = true;  // not within base64
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const Line line(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.is_empty()) continue;
    if (line.ends_brackets()) {
      levels.reset();
      is_certain = true;
    }
    is_certain &= line.text().find("binary") == string_view::npos;
    nesting.indentation = std::max(nesting.indentation, line.indentation());
    const std::size_t first = line.first_certain(), last = line.last_certain();
    for (std::size_t i = 0; i < line.text().size(); ++i) {
      if (is_opening(line.text()[i])) levels.open();
      const bool counts = is_certain && i >= first && i < last;
      if (is_closing(line.text()[i]) && counts) levels.close();
    }
  }
  nesting.brackets = levels.greatest();
  return nesting;
}

// Returns the offset after a tag, without its '<'. npos if it does not end.
std::size_t tag_end(string_view text, std::size_t at) {
  char quote = 0;
  for (; at < text.size(); ++at) {
    const char c = text[at];
    if (quote != 0) {
      if (c == quote) quote = 0;
    } else if (c == '"' || c == '\'') {
      quote = c;
    } else if (c == '>') {
      return at + 1;
    }
  }
  return string_view::npos;
}

// Returns whether all comments, tags and elements of XML end.
bool is_complete_xml(string_view text) {
  constexpr string_view kComment = "<!--", kCommentEnd = "-->";
  int depth = 0;
  for (std::size_t at = text.find('<'); at < text.size(); at = text.find('<', at)) {
    if (text.substr(at, kComment.size()) == kComment) {
      at = text.find(kCommentEnd, at + kComment.size());
      if (at == string_view::npos) return false;
      continue;
    }
    const std::size_t end = tag_end(text, at + 1);
    if (end == string_view::npos) return false;
    const char first = text[at + 1], last = text[end - 2];
    if (first == '/') {
      --depth;
    } else if (first != '?' && first != '!' && last != '/') {
      ++depth;
    }
    at = end;
  }
  return depth == 0;
}

}  // namespace

Status check_storage_text(string_view text, const std::string& path) {
  if (const std::size_t at = text.find('\0'); at != string_view::npos) {
    return invalid_file("{}: not a text: it has a zero [byte {}]", path, at);
  }
  for (const string_view mark : {string_view("$base64$"), string_view("binary")}) {
    if (text.find(mark) == string_view::npos) continue;
    return unsupported("{}: base64 is not supported; write the numbers as text", path);
  }
  if (text.find('<') == string_view::npos || text.substr(0, 1) == "{") return {};
  const string_view start = text.substr(text.find_first_not_of("\xEF\xBB\xBF \t\r\n"));
  if (start.substr(0, 1) != "<") return {};
  // Its parser takes a carriage return for the end of a line.
  for (std::size_t at = text.find('\r'); at < text.size(); at = text.find('\r', at + 1)) {
    if (text.substr(at + 1, 1) == "\n") continue;
    return invalid_file("{}: a carriage return within a line [byte {}]", path, at);
  }
  if (is_complete_xml(text)) return {};
  return invalid_file("{}: not valid XML (a comment, a tag or an element has no end)", path);
}

Status check_storage_nesting(string_view text, const std::string& path) {
  if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);
  YamlNesting nesting;
  if (text.substr(0, 1) == "{") {
    nesting.brackets = json_nesting(text);
  } else if (text.substr(0, 1) == "<") {
    nesting.brackets = xml_nesting(text);
  } else {
    nesting = yaml_nesting(text);
  }
  if (nesting.brackets > kMaxStorageNesting) {
    return invalid_file("{}: more than {} nested lists, maps or elements", path,
                        kMaxStorageNesting);
  }
  if (nesting.indentation > kMaxStorageIndentation) {
    return invalid_file("{}: a line is indented too far, or has too many ':' and '-' (limit {})",
                        path, kMaxStorageIndentation);
  }
  return {};
}

}  // namespace stgs::encoder
