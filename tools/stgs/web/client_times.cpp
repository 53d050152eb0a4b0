// SPDX-License-Identifier: Apache-2.0
#include "client_times.h"

#include <linux/tcp.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cstddef>
#include <optional>

#include "session.h"

namespace stgs::tools {
namespace {

constexpr double kRequestSeconds = 15;  // for the header of a request
constexpr double kMeasureSeconds = 10;  // between two measurements of the rate of a client
constexpr double kMinRate = 4 << 10;    // bytes per second that a client receives

// Returns the bytes that the client has received on a connection; none if Linux does not count them
// (before 4.1) or the connection has ended.
std::optional<std::uint64_t> received_bytes(int socket) {
  tcp_info info{};
  socklen_t size = sizeof info;
  if (::getsockopt(socket, IPPROTO_TCP, TCP_INFO, &info, &size) != 0 ||
      size < offsetof(tcp_info, tcpi_bytes_acked) + sizeof info.tcpi_bytes_acked) {
    return std::nullopt;
  }
  return info.tcpi_bytes_acked;
}

}  // namespace

struct ClientTimes::Client {
  enum State { kRequest, kPreparing, kSending };

  int socket;
  double since;  // now_seconds() at the start of kRequest, or at the last measurement of kSending
  State state = kRequest;
  std::uint64_t received = 0;  // bytes at the last measurement
};

ClientTimes::ClientTimes() = default;
ClientTimes::~ClientTimes() = default;

ClientTimes::Client* ClientTimes::add(int socket) {
  const std::lock_guard lock(mutex_);
  return &clients_.emplace_back(Client{socket, now_seconds()});
}

void ClientTimes::remove(const Client* client) {
  const std::lock_guard lock(mutex_);
  clients_.remove_if([client](const Client& c) { return &c == client; });
}

void ClientTimes::prepare_answer(Client* client) {
  const std::lock_guard lock(mutex_);
  client->state = Client::kPreparing;
}

void ClientTimes::send_answer(Client* client) {
  const std::lock_guard lock(mutex_);
  client->state = Client::kSending;
  client->since = now_seconds();
  client->received = received_bytes(client->socket).value_or(0);
}

void ClientTimes::expect_request(Client* client) {
  const std::lock_guard lock(mutex_);
  client->state = Client::kRequest;
  client->since = now_seconds();
}

void ClientTimes::end_slow() {
  const std::lock_guard lock(mutex_);
  const double now = now_seconds();
  for (Client& client : clients_) {
    const double seconds = now - client.since;
    if (client.state == Client::kRequest && seconds > kRequestSeconds) {
      ::shutdown(client.socket, SHUT_RDWR);
    } else if (client.state == Client::kSending && seconds > kMeasureSeconds) {
      const auto received = received_bytes(client.socket);
      if (!received) continue;  // the time without any progress remains limited
      const auto bytes = static_cast<double>(*received - client.received);
      if (bytes < kMinRate * seconds) {
        // Unsent data is discarded when the socket is closed.
        const linger reset{1, 0};
        ::setsockopt(client.socket, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
        ::shutdown(client.socket, SHUT_RDWR);
      }
      client.since = now;
      client.received = *received;
    }
  }
}

}  // namespace stgs::tools
