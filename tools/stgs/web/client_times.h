// SPDX-License-Identifier: Apache-2.0
// Ends connections whose clients are slow, so that they do not keep others out.
#pragma once

#include <cstdint>
#include <list>
#include <mutex>

namespace stgs::tools {

// The open connections of a server. Any thread.
class ClientTimes {
 public:
  struct Client;  // a connection

  ClientTimes();
  ~ClientTimes();
  ClientTimes(const ClientTimes&) = delete;
  ClientTimes& operator=(const ClientTimes&) = delete;

  // Adds a connection, from which the header of a request is expected. Valid until remove(), which
  // comes before the socket is closed. Throws std::bad_alloc.
  Client* add(int socket);
  void remove(const Client* client);
  // The header of a request is complete: an answer is prepared, which has no limit of time.
  void prepare_answer(Client* client);
  // The answer is being sent.
  void send_answer(Client* client);
  // The answer is complete: the header of another request is expected.
  void expect_request(Client* client);
  // Shuts down the connections of slow clients: the header of a request takes at most 15 s, and a
  // client receives at least 4 KiB/s of an answer, on average over 10 s.
  void end_slow();

 private:
  std::mutex mutex_;
  std::list<Client> clients_;
};

}  // namespace stgs::tools
