// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "command.h"
#include "end_after_signal.h"
#include "location.h"
#include "output_folder.h"
#include "output_path.h"
#include "printable.h"
#include "scene_file.h"
#include "standard_streams.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/output_file.h"
#include "web/site_page.h"
#ifdef STGS_HAS_WEB
#include "web/scene_audio.h"
#include "web/site_files.h"
#endif

namespace stgs::tools {
namespace {

constexpr const char* kSceneName = "scene.stgs";  // on the site
constexpr const char* kPageName = "index.html";

// Returns whether a text is an origin in the form in which browsers serialise and compare it.
bool is_origin(std::string_view text) {
  const bool is_https = text.starts_with("https://");
  if (!is_https && !text.starts_with("http://")) return false;
  text.remove_prefix(text.find("://") + 3);
  const std::size_t bracket = text.rfind(']');  // of an IPv6 address
  const std::size_t colon = text.find(':', bracket == text.npos ? 0 : bracket);
  const std::string_view host = text.substr(0, colon);
  constexpr std::string_view kHost = "abcdefghijklmnopqrstuvwxyz0123456789-._[:]";
  if (host.empty() || host.find_first_not_of(kHost) != host.npos) return false;
  if (colon == text.npos) return true;
  const std::string_view port = text.substr(colon + 1);
  return !port.empty() && port.size() <= 5 && port[0] != '0' &&
         port.find_first_not_of("0123456789") == port.npos && port != (is_https ? "443" : "80");
}

class Web final : public Command {
 public:
  Help help() const override {
    return {
        "web", "Write a web page that plays a scene",
        "Writes a folder with a page, the player and a copy of the scene: put it on any web\n"
        "server that answers range requests, such as nginx, and send the link. If the scene names\n"
        "an audio file in its folder or below, it is copied as well. Of a URL, the page plays the\n"
        "scene from there, and nothing is copied. --single-file writes one HTML file with\n"
        "everything in it, which a browser opens from disk: for scenes up to 256 MiB, with audio\n"
        "files up to 32 MiB.",
        "  stgs web scene.stgs -o site\n"
        "  stgs web scene.stgs -o scene.html --single-file\n"
        "  stgs web https://example.org/scene.stgs -o site"};
  }
  Shared shared() const override { return {.log_level = true, .urls = true}; }
  void declare(Arguments& app) override {
    app.add_option("FILE", scene_, "The .stgs file: a path or URL")->required();
    app.add_option("-o,--output", output_, "Output folder; with --single-file, an .html file")
        ->required();
    app.add_flag("--single-file", single_file_, "Write one HTML file");
    app.add_option("--title", title_, "Title of the page; default: that of the scene, or its name");
    app.add_option("--bridge", bridge_,
                   "Origin of pages that may embed and control the page; may be repeated")
        ->allow_extra_args(false);
    app.add_flag("--overwrite", overwrite_, "Replace the files of an existing page");
  }

  Status run(Session& session) override {
    if (is_standard_input(scene_)) {
      return usage_error("web cannot read standard input; write the data to a file first");
    }
    STGS_TRY(check_output());
    STGS_TRY(check_url());
    for (const std::string& origin : bridge_) STGS_TRY(check_origin(origin));
#ifdef STGS_HAS_WEB
    return write(session);
#else
    (void)session;
    return not_built(
        "'web' is not part of this build: it needs the player for browsers (Debian: emscripten, "
        "node-typescript, esbuild)");
#endif
  }

 private:
  Status check_output() const {
    if (!single_file_) return check_extension(output_, "web", "");
    constexpr std::string_view kEnding = ".html";
    const bool is_page =
        output_.size() > kEnding.size() &&
        std::string_view(output_).substr(output_.size() - kEnding.size()) == kEnding;
    if (is_page) return {};
    return usage_error("{}: web --single-file writes an .html file; use a name that ends in .html",
                       output_);
  }
  Status check_url() const {
    if (!is_url(scene_)) return {};
    if (single_file_) {
      return usage_error("{}: --single-file needs a local file; download the scene first",
                         display_name(scene_));
    }
    const std::size_t host = scene_.find("://") + 3;
    const std::size_t end = scene_.find_first_of("/?#", host);
    if (scene_.substr(host, end - host).find('@') == std::string::npos) return {};
    return usage_error("{}: the page would show the user name or password; use a URL without them",
                       display_name(scene_));
  }
  static Status check_origin(const std::string& origin) {
    if (is_origin(origin)) return {};
    return usage_error(
        "--bridge {}: not an origin (expected one such as https://page.example: in lower case, in "
        "ASCII, without the port 443 of https or 80 of http)",
        one_line(origin));
  }
  std::string written_page() const {
    return single_file_ ? output_ : (std::filesystem::path(output_) / kPageName).string();
  }

#ifdef STGS_HAS_WEB
  Status write(Session& session) {
    if (!overwrite_) STGS_TRY(check_new());
    STGS_TRY(single_file_ ? session.claim_output(output_) : session.claim_folder(output_));
    STGS_ASSIGN(const auto file, SceneFile::open(session, scene_));
    STGS_TRY(check_playable(session, *file));
    STGS_TRY(file->warn_of_open_damage());
    const auto audio = find_audio(session, *file);
    if (audio && !single_file_ && !overwrite_) STGS_TRY(check_free(on_site(audio->name)));
    PageSettings page;
    page.title = title_.empty() ? file->text(STGS_TEXT_TITLE) : title_;
    if (page.title.empty()) page.title = stem();
    for (const std::string& origin : bridge_)
      page.bridge += (page.bridge.empty() ? "" : " ") + origin;
    const EndAfterSignal end(session, output_ + ": not written");
    std::uint64_t bytes = 0;
    const SceneAudio* const sound = audio ? &*audio : nullptr;
    STGS_TRY(single_file_ ? write_file(page, sound, bytes)
                          : write_site(session, page, sound, bytes));
    if (audio) {
      session.log(2, fmt::format("{}: with the audio file {} ({})", written_page(),
                                 one_line(audio->name), human_bytes(audio->bytes->size())));
    }
    const Json json = {{"input", display_name(scene_)},
                       {"output", output_},
                       {"page", written_page()},
                       {"single_file", single_file_},
                       {"scene_copied", !is_url(scene_)},
                       {"audio", audio ? Json(audio->name) : Json()},
                       { "bytes",
                         bytes }};
    return session.emit(json,
                        fmt::format("{}: {}\n", one_line(written_page()), human_bytes(bytes)));
  }
  std::string on_site(std::string_view name) const {
    return (std::filesystem::path(output_) / name).string();
  }
  // Checks that no file would be replaced, besides the audio file, whose name is not known yet.
  Status check_new() const {
    STGS_TRY(check_free(written_page()));
    if (single_file_) return {};
    if (!is_url(scene_)) STGS_TRY(check_free(on_site(kSceneName)));
    for (const SiteFile& file : kSite) STGS_TRY(check_free(on_site(file.name)));
    return {};
  }
  static Status check_free(const std::string& path) {
    std::error_code error;
    if (!std::filesystem::exists(path, error)) return {};
    return usage_error("{}: exists; name another output, or replace it with --overwrite", path);
  }
  // Opens the audio file of a scene on disk. Nothing if there is none; with a warning if the scene
  // names one that the page cannot have.
  std::optional<SceneAudio> find_audio(Session& session, const SceneFile& file) const {
    const std::string location = file.text(STGS_TEXT_AUDIO);
    if (location.empty() || is_url(scene_)) return {};
    auto audio = open_audio(scene_, location);
    Status status = audio.status();
    if (audio.ok() && single_file_ && audio->bytes->size() > kMaxSinglePageAudio) {
      status = Status(StatusCode::kLimit,
                      fmt::format("the audio file '{}' is too large for a page of one file ({}, "
                                  "limit {} MiB); write a site without --single-file",
                                  one_line(audio->name), human_bytes(audio->bytes->size()),
                                  kMaxSinglePageAudio >> 20));
    }
    if (status.ok()) return std::move(audio).value();
    session.log(1, silent_warning(file.name(), status));
    return {};
  }
  Status check_playable(Session& session, const SceneFile& file) const {
    if (file.text(STGS_TEXT_PROFILE) == "draco") {
      return unsupported(
          "{}: browsers cannot play the profile draco; pack the scene again without it",
          file.name());
    }
    auto contents = sized<stgs_contents>();
    STGS_TRY(file.check(stgs_scene_get_contents(file.get(), &contents)));
    if (contents.form == STGS_FORM_GROWING) {
      session.log(1,
                  fmt::format("{}: the recording is not closed; the page plays its present content",
                              file.name()));
    }
    return {};
  }
  std::string stem() const {
    const std::string name = display_name(scene_);
    return std::filesystem::path(name).stem().string();
  }
  Status write_file(const PageSettings& page, const SceneAudio* audio, std::uint64_t& bytes) const {
    STGS_ASSIGN(const auto scene, open_file(scene_));
    if (scene->size() > kMaxSinglePageScene) {
      return Status(
          StatusCode::kLimit,
          fmt::format("{}: {} is too large for a page of one file (limit {} MiB); write a "
                      "site without --single-file",
                      scene_, human_bytes(scene->size()), kMaxSinglePageScene >> 20));
    }
    OutputFile out;
    STGS_TRY(out.open(output_));
    SinglePageContent content{*scene};
    if (audio != nullptr) {
      content.audio = audio->bytes.get();
      content.audio_type = audio_type(audio->name);
    }
    STGS_TRY(write_single_page(page, content, [&](std::span<const std::uint8_t> piece) {
      bytes += piece.size();
      return out.write(piece);
    }));
    return out.commit();
  }
  Status write_site(Session& session, PageSettings page, const SceneAudio* audio,
                    std::uint64_t& bytes) const {
    OutputFolder folder(output_, session.log_sink());
    if (is_url(scene_)) {
      page.scene = scene_;
    } else {
      page.scene = kSceneName;
      STGS_ASSIGN(const auto scene, open_file(scene_));
      STGS_TRY(copy(folder, kSceneName, *scene, bytes));
    }
    if (audio != nullptr) STGS_TRY(copy(folder, audio->name, *audio->bytes, bytes));
    for (const SiteFile& file : kSite)
      STGS_TRY(add(folder, std::string(file.name), file.bytes, bytes));
    // Last, so that it appears once the files that it loads have.
    STGS_TRY(add(folder, kPageName, site_page(page), bytes));
    return folder.commit();
  }
  static Status add(OutputFolder& folder, const std::string& name, std::string_view content,
                    std::uint64_t& bytes) {
    STGS_ASSIGN(const std::string path, folder.add(name));
    bytes += content.size();
    return write_file_atomically(
        path, {reinterpret_cast<const std::uint8_t*>(content.data()), content.size()});
  }
  static Status copy(OutputFolder& folder, const std::string& name, const ByteSource& from,
                     std::uint64_t& bytes) {
    constexpr std::size_t kChunk = std::size_t{4} << 20;
    STGS_ASSIGN(const std::string path, folder.add(name));
    OutputFile out;
    STGS_TRY(out.open(path));
    std::vector<std::uint8_t> piece;
    for (std::uint64_t at = 0; at < from.size(); at += piece.size()) {
      piece.resize(std::min<std::uint64_t>(kChunk, from.size() - at));
      STGS_TRY(from.read(at, piece));
      STGS_TRY(out.write(piece));
    }
    bytes += from.size();
    return out.commit();
  }
#endif

  std::string scene_, output_, title_;
  std::vector<std::string> bridge_;
  bool single_file_ = false, overwrite_ = false;
};

}  // namespace

std::unique_ptr<Command> make_web() {
  return std::make_unique<Web>();
}

}  // namespace stgs::tools
