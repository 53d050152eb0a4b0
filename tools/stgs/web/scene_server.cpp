// SPDX-License-Identifier: Apache-2.0
#include "scene_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <new>
#include <utility>

#include "client_times.h"
#include "file_request.h"
#include "scene_audio.h"
#include "site_files.h"
#include "site_page.h"
#include "stgs/format/escape.h"

namespace stgs::tools {
namespace {

constexpr unsigned kMaxConnections = 128;
constexpr unsigned kMaxOfAddress = 32;               // connections; a browser has about six
constexpr std::size_t kConnectionMemory = 32 << 10;  // bytes; the header of a request must fit
// Time without progress of a response. Socket buffers may accept more bytes at once than a client
// at the minimum rate (client_times.h) receives in minutes.
constexpr unsigned kIdleSeconds = 300;
constexpr std::time_t kSettleSeconds = 10;  // since the last write; until then a file may grow
constexpr std::string_view kScenes = "/scenes/", kList = "/scenes.json";
constexpr std::string_view kSceneType = "application/octet-stream";
// The page loads its own files, scenes of this server and by https, and their sound; its script
// makes style sheets and workers.
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
    "style-src 'unsafe-inline'; img-src data:; connect-src 'self' https:; media-src 'self' https:; "
    "base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'";

using Response = std::unique_ptr<MHD_Response, void (*)(MHD_Response*)>;

Response own(MHD_Response* response) {
  return {response, [](MHD_Response* r) {
            if (r != nullptr) MHD_destroy_response(r);
          }};
}

Response copied_text(std::string_view text) {
  return own(MHD_create_response_from_buffer(text.size(), const_cast<char*>(text.data()),
                                             MHD_RESPMEM_MUST_COPY));
}

void set_header(const Response& response, const char* name, const std::string& value) {
  MHD_add_response_header(response.get(), name, value.c_str());
}

MHD_Result send(MHD_Connection* connection, int status, const Response& response) {
  if (response == nullptr) return MHD_NO;  // without memory: ends the connection
  set_header(response, "X-Content-Type-Options", "nosniff");
  set_header(response, "Referrer-Policy", "no-referrer");
  set_header(response, "Cross-Origin-Resource-Policy", "same-origin");
  set_header(response, "Content-Security-Policy", kPolicy);
  return MHD_queue_response(connection, static_cast<unsigned>(status), response.get());
}

MHD_Result send_text(MHD_Connection* connection, int status, std::string_view text,
                     const char* type = "text/plain; charset=utf-8") {
  const Response response = copied_text(text);
  if (response != nullptr) {
    set_header(response, "Content-Type", type);
    set_header(response, "Cache-Control", "no-store");
    if (status == 405) set_header(response, "Allow", "GET, HEAD");
  }
  return send(connection, status, response);
}

std::optional<std::string> header(MHD_Connection* connection, const char* name) {
  const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value == nullptr ? std::optional<std::string>() : std::string(value);
}

FileVersion version_of(const struct stat& info) {
  return {static_cast<std::uint64_t>(info.st_size),
          fmt::format("\"{:x}-{:x}-{:x}.{:x}\"", info.st_ino, info.st_size, info.st_mtim.tv_sec,
                      info.st_mtim.tv_nsec),
          http_date(info.st_mtim.tv_sec)};
}

MHD_Result send_file(MHD_Connection* connection, encoder::CaptureFile file, std::string_view type) {
  struct stat info {};
  if (::fstat(file.descriptor(), &info) != 0) return send_text(connection, 404, "not found\n");
  const FileVersion version = version_of(info);
  const FileAnswer answer =
      answer_file(version, {header(connection, "Range"), header(connection, "If-Range"),
                            header(connection, "If-Match"), header(connection, "If-None-Match"),
                            header(connection, "If-Modified-Since")});
  Response response = copied_text("");
  if (answer.length > 0) {
    response = own(
        MHD_create_response_from_fd_at_offset64(answer.length, file.descriptor(), answer.begin));
    if (response != nullptr) (void)file.release();  // the response closes it
  }
  if (response == nullptr) return MHD_NO;
  const bool may_grow = std::time(nullptr) - info.st_mtim.tv_sec < kSettleSeconds;
  set_header(response, "ETag", version.etag);
  set_header(response, "Last-Modified", version.last_modified);
  set_header(response, "Accept-Ranges", "bytes");
  set_header(response, "Cache-Control", may_grow ? "no-store" : "no-cache");
  if (answer.status == 200 || answer.status == 206) {
    set_header(response, "Content-Type", std::string(type));
  }
  if (answer.status == 206) {
    set_header(response, "Content-Range",
               fmt::format("bytes {}-{}/{}", answer.begin, answer.begin + answer.length - 1,
                           version.bytes));
  } else if (answer.status == 416) {
    set_header(response, "Content-Range", fmt::format("bytes */{}", version.bytes));
  }
  return send(connection, answer.status, response);
}

int count_hosts(MHD_Connection* connection) {
  const auto count = [](void* total, MHD_ValueKind, const char* name, const char*) {
    if (strcasecmp(name, "Host") == 0) ++*static_cast<int*>(total);
    return MHD_YES;
  };
  int hosts = 0;
  MHD_get_connection_values(connection, MHD_HEADER_KIND, count, &hosts);
  return hosts;
}

// Returns the connection's entry; null if there was no memory for it.
ClientTimes::Client* client_of(MHD_Connection* connection) {
  const MHD_ConnectionInfo* info =
      MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
  return info == nullptr ? nullptr : static_cast<ClientTimes::Client*>(info->socket_context);
}

class Server final : public SceneServer {
 public:
  Server(std::shared_ptr<const ServedScenes> scenes, ServerSettings settings)
      : scenes_(std::move(scenes)), settings_(std::move(settings)) {
    PageSettings page;
    page.title = settings_.title;
    if (scenes_->is_folder()) {
      page.list = kList.substr(1);
    } else {
      page.scene = std::string(kScenes.substr(1)) + escape_url(scenes_->file_name(), kUrlPath);
    }
    page_ = site_page(page);
  }
  ~Server() override {
    if (daemon_ != nullptr) MHD_stop_daemon(daemon_);
  }
  Status listen();
  std::string url() const override {
    const bool is_v6 = settings_.address.find(':') != std::string::npos;
    const std::string host = is_v6 ? "[" + settings_.address + "]" : settings_.address;
    return fmt::format("http://{}:{}/", host, port_);
  }
  int port() const override { return port_; }
  void end_slow_clients() override { times_.end_slow(); }

 private:
  static MHD_Result handle(void* self, MHD_Connection* connection, const char* url,
                           const char* method, const char*, const char*, std::size_t*,
                           void** state);
  static void on_connection(void* self, MHD_Connection* connection, void** client,
                            MHD_ConnectionNotificationCode code);
  static void on_completed(void* self, MHD_Connection* connection, void**,
                           MHD_RequestTerminationCode);
  MHD_Result answer(MHD_Connection* connection, std::string_view url, std::string_view method);
  MHD_Result answer_path(MHD_Connection* connection, const std::string& path);

  std::shared_ptr<const ServedScenes> scenes_;
  ServerSettings settings_;
  std::string page_;
  ClientTimes times_;
  MHD_Daemon* daemon_ = nullptr;
  int port_ = 0;
};

MHD_Result Server::answer(MHD_Connection* connection, std::string_view url,
                          std::string_view method) {
  const auto host = header(connection, "Host");
  if (count_hosts(connection) != 1) return send_text(connection, 400, "one Host field is needed\n");
  if (!is_permitted_host(*host)) {
    return send_text(connection, 421, "this server answers to its address and to localhost only\n");
  }
  if (method != "GET" && method != "HEAD") return send_text(connection, 405, "use GET or HEAD\n");
  const auto path = decode_url_path(url);
  if (!path || path->empty() || path->front() != '/')
    return send_text(connection, 400, "the path is malformed\n");
  return answer_path(connection, *path);
}

MHD_Result Server::answer_path(MHD_Connection* connection, const std::string& path) {
  if (path == "/" || path == "/index.html") {
    return send_text(connection, 200, page_, "text/html; charset=utf-8");
  }
  for (const SiteFile& file : kSite) {
    if (path.substr(1) != file.name) continue;
    const Response response = own(MHD_create_response_from_buffer(
        file.bytes.size(), const_cast<char*>(file.bytes.data()), MHD_RESPMEM_PERSISTENT));
    if (response != nullptr) {
      set_header(response, "Content-Type", std::string(file.type));
      set_header(response, "Cache-Control", "no-cache");
    }
    return send(connection, 200, response);
  }
  if (path == kList && scenes_->is_folder()) {
    return send_text(connection, 200, json_text(scenes_->list(std::string(kScenes.substr(1)))),
                     "application/json");
  }
  if (path.compare(0, kScenes.size(), kScenes) == 0) {
    const std::string name = path.substr(kScenes.size());
    auto scene = scenes_->open_scene(name);
    if (scene.ok()) return send_file(connection, std::move(scene).value(), kSceneType);
    auto audio = scenes_->open_audio(name);
    if (audio.ok()) return send_file(connection, std::move(audio).value(), audio_type(name));
  }
  return send_text(connection, 404, "not found\n");
}

MHD_Result Server::handle(void* self, MHD_Connection* connection, const char* url,
                          const char* method, const char*, const char*, std::size_t*,
                          void** state) {
  auto* server = static_cast<Server*>(self);
  ClientTimes::Client* const client = client_of(connection);
  if (client != nullptr) server->times_.prepare_answer(client);
  try {
    // The first call comes before the body. An answer to it ends the connection; after one to the
    // second call, the connection may be used again.
    const bool is_first = std::exchange(*state, self) == nullptr;
    const bool has_body = header(connection, "Content-Length").value_or("0") != "0" ||
                          header(connection, "Transfer-Encoding").has_value();
    if (is_first && !has_body) return MHD_YES;
    const MHD_Result result = server->answer(connection, url, method);
    if (client != nullptr) server->times_.send_answer(client);
    return result;
  } catch (const std::exception&) {
    return MHD_NO;  // ends the connection
  }
}

void Server::on_completed(void* self, MHD_Connection* connection, void**,
                          MHD_RequestTerminationCode) {
  ClientTimes::Client* const client = client_of(connection);
  if (client != nullptr) static_cast<Server*>(self)->times_.expect_request(client);
}

void Server::on_connection(void* self, MHD_Connection* connection, void** client,
                           MHD_ConnectionNotificationCode code) {
  ClientTimes& times = static_cast<Server*>(self)->times_;
  if (code == MHD_CONNECTION_NOTIFY_CLOSED) {
    times.remove(static_cast<ClientTimes::Client*>(*client));
    *client = nullptr;
    return;
  }
  const MHD_ConnectionInfo* info =
      MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
  if (info == nullptr) return;
  try {
    *client = times.add(info->connect_fd);
  } catch (const std::bad_alloc&) {
    ::shutdown(info->connect_fd, SHUT_RDWR);  // its time would not be limited
  }
}

// Returns a listening socket and the address that it has.
Result<int> listening_socket(const std::string& address, int port, sockaddr_storage& bound) {
  auto& v4 = reinterpret_cast<sockaddr_in&>(bound);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(bound);
  socklen_t length = 0;
  if (::inet_pton(AF_INET, address.c_str(), &v4.sin_addr) == 1) {
    v4.sin_family = AF_INET;
    v4.sin_port = htons(static_cast<std::uint16_t>(port));
    length = sizeof v4;
  } else if (::inet_pton(AF_INET6, address.c_str(), &v6.sin6_addr) == 1) {
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(static_cast<std::uint16_t>(port));
    length = sizeof v6;
  } else {
    return usage_error("--address {}: not an IP address; use one of this machine", address);
  }
  const int fd = ::socket(bound.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int on = 1;
  auto* generic = reinterpret_cast<sockaddr*>(&bound);
  if (fd >= 0 && ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
      ::bind(fd, generic, length) == 0 && ::listen(fd, SOMAXCONN) == 0 &&
      ::getsockname(fd, generic, &length) == 0) {
    return fd;
  }
  const int error = errno;
  if (fd >= 0) ::close(fd);
  return io_error("{} port {}: cannot listen: {}; use another --port or --address", address, port,
                  system_message(error));
}

Status Server::listen() {
  sockaddr_storage bound{};
  STGS_ASSIGN(const int fd, listening_socket(settings_.address, settings_.port, bound));
  port_ = ntohs(bound.ss_family == AF_INET ? reinterpret_cast<sockaddr_in&>(bound).sin_port
                                           : reinterpret_cast<sockaddr_in6&>(bound).sin6_port);
  const unsigned v6 = bound.ss_family == AF_INET6 ? MHD_USE_IPv6 : 0;
  // All programs on this machine have the same address, so there is no limit per address.
  const unsigned of_address = is_loopback(settings_.address) ? 0 : kMaxOfAddress;
  // Paths are decoded by decode_url_path(), which reports malformed ones.
  const auto keep = [](void*, MHD_Connection*, char* text) { return std::strlen(text); };
  std::size_t (*const unescape)(void*, MHD_Connection*, char*) = keep;
  daemon_ = MHD_start_daemon(
      MHD_USE_POLL_INTERNAL_THREAD | MHD_USE_ITC | v6, 0, nullptr, nullptr, &Server::handle, this,
      MHD_OPTION_LISTEN_SOCKET, fd, MHD_OPTION_CONNECTION_LIMIT, kMaxConnections,
      MHD_OPTION_PER_IP_CONNECTION_LIMIT, of_address, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
      kConnectionMemory, MHD_OPTION_CONNECTION_TIMEOUT, kIdleSeconds, MHD_OPTION_NOTIFY_CONNECTION,
      &Server::on_connection, this, MHD_OPTION_NOTIFY_COMPLETED, &Server::on_completed, this,
      MHD_OPTION_UNESCAPE_CALLBACK, unescape, nullptr, MHD_OPTION_STRICT_FOR_CLIENT, 1,
      MHD_OPTION_END);
  if (daemon_ != nullptr) return {};
  ::close(fd);
  return runtime_error("the HTTP server cannot be started: {}", system_message(errno));
}

}  // namespace

bool is_loopback(const std::string& address) {
  return address.rfind("127.", 0) == 0 || address == "::1";
}

Result<std::unique_ptr<SceneServer>> SceneServer::start(std::shared_ptr<const ServedScenes> scenes,
                                                        const ServerSettings& settings) {
  auto server = std::make_unique<Server>(std::move(scenes), settings);
  STGS_TRY(server->listen());
  return std::unique_ptr<SceneServer>(std::move(server));
}

}  // namespace stgs::tools
