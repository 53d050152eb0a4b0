// SPDX-License-Identifier: Apache-2.0
// A server on 127.0.0.1 that answers requests with fixed texts, or not at all.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace stgs::testing {

class SmallServer {
 public:
  // `responses`: to the first requests, with headers; empty: none is sent, as to later requests,
  // and the connection stays open.
  explicit SmallServer(std::vector<std::string> responses = {}) : responses_(std::move(responses)) {
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    auto* const any = reinterpret_cast<sockaddr*>(&address);
    if (bind(listener_, any, size) != 0 || listen(listener_, 16) != 0 ||
        getsockname(listener_, any, &size) != 0) {
      throw std::runtime_error("cannot listen on 127.0.0.1");
    }
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
  }
  ~SmallServer() {
    thread_.request_stop();
    thread_.join();
    close(listener_);
  }
  SmallServer(const SmallServer&) = delete;
  SmallServer& operator=(const SmallServer&) = delete;

  int port() const { return port_; }
  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_) + "/x.stgs"; }
  // Returns the number of requests so far.
  int requests() const { return requests_; }
  // Returns the text of a request, from 0, that has been answered.
  std::string request(std::size_t number) const {
    const std::lock_guard lock(mutex_);
    return texts_.at(number);
  }
  void wait_for_requests(int count) const {
    while (requests_ < count) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

 private:
  void serve(const std::stop_token& stop) {
    std::vector<pollfd> sockets = {{listener_, POLLIN, 0}};
    while (!stop.stop_requested()) {
      if (poll(sockets.data(), sockets.size(), 5) <= 0) continue;
      const std::size_t count = sockets.size();
      for (std::size_t i = 1; i < count; ++i) {
        if (sockets[i].revents != 0) answer(sockets[i]);
      }
      if (sockets[0].revents != 0)
        sockets.push_back({accept(listener_, nullptr, nullptr), POLLIN, 0});
      std::erase_if(sockets, [](const pollfd& socket) { return socket.fd < 0; });
    }
    for (std::size_t i = 1; i < sockets.size(); ++i) close(sockets[i].fd);
  }

  // Reads a request, which arrives at once, and answers it.
  void answer(pollfd& socket) {
    char request[4096];
    const ssize_t size = recv(socket.fd, request, sizeof(request), 0);
    if (size <= 0) {
      close(std::exchange(socket.fd, -1));
      return;
    }
    {
      const std::lock_guard lock(mutex_);
      texts_.emplace_back(request, static_cast<std::size_t>(size));
    }
    const auto number = static_cast<std::size_t>(requests_++);
    if (number >= responses_.size()) return;
    const std::string& response = responses_[number];
    (void)!send(socket.fd, response.data(), response.size(), MSG_NOSIGNAL);
  }

  std::vector<std::string> responses_;
  mutable std::mutex mutex_;
  std::vector<std::string> texts_;  // of the requests
  int listener_ = -1, port_ = 0;
  std::atomic<int> requests_ = 0;
  std::jthread thread_;
};

// A response with the first 4 bytes of a file of 4000.
inline const std::string kFourBytes =
    "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-3/4000\r\nContent-Length: "
    "4\r\n\r\nstgs";

}  // namespace stgs::testing
