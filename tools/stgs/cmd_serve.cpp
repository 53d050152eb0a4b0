// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <filesystem>
#include <thread>

#include "command.h"
#include "location.h"
#include "options.h"
#include "printable.h"
#include "scene_file.h"
#ifdef STGS_HAS_SERVE
#include "web/scene_audio.h"
#include "web/scene_server.h"
#endif

namespace stgs::tools {
namespace {

constexpr double kMaxPort = 65535;

class Serve final : public Command {
 public:
  Help help() const override {
    return {
        "serve", "Show scenes in a browser, from this machine",
        "Serves a page that plays an .stgs file, or lists the .stgs files below a folder, and\n"
        "prints its link. Also serves the audio files that the scenes name, if they are in the\n"
        "folder of the scene or below. Serves nothing else: no other files, no hidden ones, and\n"
        "no links that leave the folder. After a file was written to, its page asks to load it\n"
        "again. Only programs of this machine reach the server, unless --address names another\n"
        "address. Ctrl-C (SIGINT) or SIGTERM ends it, with exit code 4. 'stgs web' writes a site\n"
        "for other servers.",
        "  stgs serve scene.stgs\n"
        "  stgs serve scenes/ --port 8000"};
  }
  Shared shared() const override { return {.log_level = true}; }
  void declare(Arguments& app) override {
    app.add_option("FILE", path_, "The .stgs file, or a folder")->required();
    app.add_option("--port", port_, "TCP port; 0: a free one")
        ->check(number_between(0, kMaxPort))
        ->capture_default_str();
    app.add_option("--address", address_,
                   "IP address of this machine to listen on; any but 127.0.0.1 and ::1 lets other "
                   "machines read the scenes")
        ->capture_default_str();
  }

  Status run(Session& session) override {
    STGS_TRY(check_is_path(path_));
    if (address_ == "0.0.0.0" || address_ == "::") {
      return usage_error("--address {}: not the address of an interface; name one", address_);
    }
#ifdef STGS_HAS_SERVE
    return serve(session);
#else
    (void)session;
    return not_built(
        "'serve' is not part of this build: it needs libmicrohttpd and the player for browsers "
        "(Debian: libmicrohttpd-dev, emscripten, node-typescript, esbuild)");
#endif
  }

 private:
#ifdef STGS_HAS_SERVE
  Status serve(Session& session) const {
    STGS_ASSIGN(const auto scenes, ServedScenes::open(path_));
    ServerSettings settings;
    settings.address = address_;
    settings.port = port_;
    settings.title = "Scenes";
    if (!scenes->is_folder()) {
      STGS_ASSIGN(const auto file, SceneFile::open(session, path_));
      STGS_TRY(file->warn_of_open_damage());
      if (const std::string audio = file->text(STGS_TEXT_AUDIO); !audio.empty()) {
        const auto opened = open_audio(path_, audio);
        if (!opened.ok()) session.log(1, silent_warning(file->name(), opened.status()));
      }
      const std::string title = file->text(STGS_TEXT_TITLE);
      settings.title = title.empty() ? std::filesystem::path(path_).stem().string() : title;
    }
    STGS_ASSIGN(const auto server, SceneServer::start(scenes, settings));
    if (!is_loopback(address_)) {
      session.log(1, fmt::format("every machine that reaches {} can read the scenes", address_));
    }
    const Json json = {{"path", path_}, {"url", server->url()}, { "port", server->port() }};
    STGS_TRY(session.emit(json, server->url() + "\n"));
    session.log(2, fmt::format("serving {}; press Ctrl-C to end", path_));
    constexpr std::chrono::milliseconds kPoll(50);
    while (!interrupted()) {
      std::this_thread::sleep_for(kPoll);
      server->end_slow_clients();
    }
    return runtime_error("{}: no longer served", path_);
  }
#endif

  std::string path_, address_ = "127.0.0.1";
  int port_ = 0;
};

}  // namespace

std::unique_ptr<Command> make_serve() {
  return std::make_unique<Serve>();
}

}  // namespace stgs::tools
