// SPDX-License-Identifier: Apache-2.0
// How a server answers a request for a file: conditions and ranges of RFC 9110, names and hosts.
// Nothing here reads files or sockets.
#pragma once

#include <cstdint>
#include <ctime>
#include <optional>
#include <string>
#include <string_view>

namespace stgs::tools {

// A version of a file.
struct FileVersion {
  std::uint64_t bytes = 0;
  std::string etag;           // with its quotes
  std::string last_modified;  // as http_date()
};

// The fields of a request that select an answer, as sent.
struct FileRequest {
  std::optional<std::string> range, if_range, if_match, if_none_match, if_modified_since;
};

struct FileAnswer {
  int status = 200;                     // 200, 206, 304, 412 or 416
  std::uint64_t begin = 0, length = 0;  // of the content, bytes; 0 for 304, 412 and 416
};

// A list of several ranges is answered with the complete file, as RFC 9110, 14.2 permits.
FileAnswer answer_file(const FileVersion& version, const FileRequest& request);

// Returns "Sun, 06 Nov 1994 08:49:37 GMT".
std::string http_date(std::time_t time);

// Returns the path of a URL with %XX decoded. Nothing for malformed escapes and for %00.
std::optional<std::string> decode_url_path(std::string_view path);

// Returns whether a path names a scene below a folder: parts that are not empty and do not begin
// with a dot, the last of which ends with ".stgs".
bool is_scene_name(std::string_view name);

// Returns whether a Host field names an address or localhost. A page of another server can make a
// browser use the name of that server for this one (DNS rebinding), but not an address.
bool is_permitted_host(std::string_view host);

}  // namespace stgs::tools
