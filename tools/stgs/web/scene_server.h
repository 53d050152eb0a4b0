// SPDX-License-Identifier: Apache-2.0
// The HTTP server of stgs serve: the viewer page, and scenes with range requests.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "served_scenes.h"
#include "stgs/format/status.h"

namespace stgs::tools {

struct ServerSettings {
  std::string address = "127.0.0.1";  // IPv4 or IPv6, of one interface
  int port = 0;                       // 0: a free one
  std::string title;                  // of the page
};

// Returns whether an address is only reachable from this machine.
bool is_loopback(const std::string& address);

// Answers GET and HEAD in a thread of its own until it is destroyed. Everything that a client
// controls is bounded: connections, those of one address unless all clients are on this machine,
// bytes of a request's header, the time for sending it, and the time for receiving an answer.
class SceneServer {
 public:
  // kIo if the address or port cannot be used, kUsage for an invalid address.
  static Result<std::unique_ptr<SceneServer>> start(std::shared_ptr<const ServedScenes> scenes,
                                                    const ServerSettings& settings);
  virtual ~SceneServer() = default;

  // Returns the link to the page.
  virtual std::string url() const = 0;
  virtual int port() const = 0;
  // Closes connections of clients that send their request or receive the answer too slowly. Call at
  // least once per second.
  virtual void end_slow_clients() = 0;
};

}  // namespace stgs::tools
