// SPDX-License-Identifier: Apache-2.0
// Reads ranges of a URL for test_fetch.py and prints the results as JSON.
//
// usage: fetch_probe URL SETTINGS OP...
//   SETTINGS  comma-separated name=value of HttpSettings, e.g. max_attempts=3,stall_seconds=1, or -
//   OP        OFFSET:BYTES               reads a range
//             refresh                    checks whether the file has changed
//             stop:SECONDS:OFFSET:BYTES  reads a range, stopped after SECONDS
//             all:COUNT                  reads the complete file COUNT times in parallel
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "stgs/player/source.h"

using namespace stgs;
using namespace stgs::player;
using Json = nlohmann::json;

namespace {

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == at) {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

HttpSettings settings_of(const std::string& text) {
  HttpSettings s;
  for (const std::string& item : split(text, ',')) {
    const std::size_t at = item.find('=');
    if (at == std::string::npos) continue;
    const std::string name = item.substr(0, at);
    const double value = std::atof(item.c_str() + at + 1);
    if (name == "max_connections") s.max_connections = static_cast<int>(value);
    if (name == "connect_seconds") s.connect_seconds = value;
    if (name == "stall_seconds") s.stall_seconds = value;
    if (name == "max_attempts") s.max_attempts = static_cast<int>(value);
    if (name == "backoff_seconds") s.backoff_seconds = value;
    if (name == "head_bytes") s.head_bytes = static_cast<std::uint64_t>(value);
  }
  return s;
}

Json to_json(const Status& status) {
  return {{"code", static_cast<int>(status.code())}, {"message", status.message()}};
}

Json read(const ByteSource& source, std::uint64_t offset, std::size_t bytes) {
  std::vector<std::uint8_t> out(bytes);
  const Status status = source.read(offset, out);
  Json json = to_json(status);
  std::string hex;
  for (std::size_t i = 0; status.ok() && i < bytes; ++i) hex += fmt::format("{:02x}", out[i]);
  if (status.ok()) json["hex"] = hex;
  return json;
}

std::uint64_t number(const std::string& text) {
  return std::strtoull(text.c_str(), nullptr, 10);
}

Json run(HttpSource& source, std::stop_source& stop, const std::string& op) {
  const std::vector<std::string> parts = split(op, ':');
  if (parts[0] == "refresh") {
    const auto change = source.refresh(source.size());
    Json json = to_json(change.status());
    if (change.ok()) {
      constexpr const char* kNames[] = {"none", "resized", "replaced"};
      json["change"] = kNames[static_cast<int>(*change)];
    }
    json["size"] = source.size();
    return json;
  }
  if (parts[0] == "stop") {
    const std::jthread later([&] {
      std::this_thread::sleep_for(std::chrono::duration<double>(std::atof(parts[1].c_str())));
      stop.request_stop();
    });
    return read(source, number(parts[2]), number(parts[3]));
  }
  if (parts[0] == "all") {
    std::vector<Json> results(number(parts[1]));
    {
      std::vector<std::jthread> threads;
      for (Json& result : results) {
        threads.emplace_back([&] { result = read(source, 0, source.size()); });
      }
    }
    return results;
  }
  return read(source, number(parts[0]), number(parts[1]));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: fetch_probe URL SETTINGS OP...\n");
    return 1;
  }
  std::stop_source stop;
  std::mutex mutex;
  Json events = Json::array();
  HttpSettings settings = settings_of(argv[2]);
  settings.stop = stop.get_token();
  settings.on_event = [&](const TransferEvent& event) {
    const std::lock_guard lock(mutex);
    events.push_back({{"kind", event.kind == TransferEvent::Kind::kRetry ? "retry" : "failed"},
                      {"offset", event.offset},
                      {"wait", event.wait_seconds},
                      {"message", event.message}});
  };
  const auto seconds = [begin = std::chrono::steady_clock::now()] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  Json out;
  auto source = open_url(argv[1], settings);
  out["open"] = to_json(source.status());
  if (source.ok()) {
    out["name"] = (*source)->name();
    out["size"] = (*source)->size();
    for (int i = 3; i < argc; ++i) {
      const double begin = seconds();
      Json result = run(**source, stop, argv[i]);
      out["ops"].push_back({{"result", result}, {"seconds", seconds() - begin}});
    }
    const TransferStatistics statistics = (*source)->statistics();
    out["statistics"] = {{"requests", statistics.requests},
                         {"bytes", statistics.bytes},
                         {"retries", statistics.retries}};
  }
  out["events"] = events;
  std::printf("%s\n", out.dump().c_str());
  return 0;
}
