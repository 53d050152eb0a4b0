// SPDX-License-Identifier: Apache-2.0
// Closes connections of slow clients, so that they do not block others.
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

  // Adds a connection that waits for the header of a request. The entry is valid until remove();
  // call that before the socket is closed. Throws std::bad_alloc.
  Client* add(int socket);
  void remove(const Client* client);
  // The header of a request is complete. There is no time limit for preparing the answer.
  void prepare_answer(Client* client);
  // The answer is being sent.
  void send_answer(Client* client);
  // The answer is complete. The connection waits for the header of another request.
  void expect_request(Client* client);
  // Shuts down the connections of slow clients: the header of a request takes at most 15 s, and a
  // client receives at least 4 KiB/s of an answer, on average over 10 s.
  void end_slow();

 private:
  std::mutex mutex_;
  std::list<Client> clients_;
};

}  // namespace stgs::tools
