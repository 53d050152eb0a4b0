// SPDX-License-Identifier: Apache-2.0
#include "ranks/mpi_module.h"

#include <mpi.h>

#include <algorithm>
#include <climits>
#include <cstdio>
#include <vector>

namespace stgs::encoder {
namespace {

// MPI is a singleton per process, and so is this state.
struct Module {
  MPI_Comm notes = MPI_COMM_NULL;  // separate from that of the gathers
  MPI_Request gather = MPI_REQUEST_NULL;
  std::vector<MPI_Request> sent;
  int rank = 0, size = 1;
};

Module& module() {
  static Module one;
  return one;
}

int init(int* rank, int* size, int* node_rank, int* node_size) {
  Module& m = module();
  int provided = 0;
  if (const int e = MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided)) return e;
  if (const int e = MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN)) return e;
  if (const int e = MPI_Comm_rank(MPI_COMM_WORLD, &m.rank)) return e;
  if (const int e = MPI_Comm_size(MPI_COMM_WORLD, &m.size)) return e;
  if (const int e = MPI_Comm_dup(MPI_COMM_WORLD, &m.notes)) return e;
  MPI_Comm node = MPI_COMM_NULL;
  if (const int e =
          MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, m.rank, MPI_INFO_NULL, &node)) {
    return e;
  }
  if (const int e = MPI_Comm_rank(node, node_rank)) return e;
  if (const int e = MPI_Comm_size(node, node_size)) return e;
  *rank = m.rank;
  *size = m.size;
  return MPI_Comm_free(&node);
}

int gather_begin(const void* own, std::size_t bytes, void* all) {
  if (bytes % 4 != 0 || bytes / 4 > INT_MAX) return MPI_ERR_COUNT;
  const int words = static_cast<int>(bytes / 4);
  return MPI_Iallgather(own, words, MPI_UINT32_T, all, words, MPI_UINT32_T, MPI_COMM_WORLD,
                        &module().gather);
}

int gather_done(int* done) {
  return MPI_Test(&module().gather, done, MPI_STATUS_IGNORE);
}

int note_send(const void* bytes, std::size_t n) {
  Module& m = module();
  for (int to = 0; to < m.size; ++to) {
    if (to == m.rank) continue;
    m.sent.push_back(MPI_REQUEST_NULL);
    if (const int e =
            MPI_Isend(bytes, static_cast<int>(n), MPI_BYTE, to, 0, m.notes, &m.sent.back())) {
      return e;
    }
  }
  return 0;
}

int note_poll(int* from, void* bytes, std::size_t n) {
  *from = -1;
  int available = 0;
  MPI_Status status;
  if (const int e = MPI_Iprobe(MPI_ANY_SOURCE, 0, module().notes, &available, &status)) return e;
  if (available == 0) return 0;
  *from = status.MPI_SOURCE;
  return MPI_Recv(bytes, static_cast<int>(n), MPI_BYTE, status.MPI_SOURCE, 0, module().notes,
                  MPI_STATUS_IGNORE);
}

int finalize() {
  Module& m = module();
  if (const int e =
          MPI_Waitall(static_cast<int>(m.sent.size()), m.sent.data(), MPI_STATUSES_IGNORE)) {
    return e;
  }
  m.sent.clear();
  if (const int e = MPI_Comm_free(&m.notes)) return e;
  return MPI_Finalize();
}

void abort(int code) {
  MPI_Abort(MPI_COMM_WORLD, code);
}

void describe(int error, char* text, std::size_t size) {
  char buffer[MPI_MAX_ERROR_STRING] = "";
  int length = 0;
  if (MPI_Error_string(error, buffer, &length) != MPI_SUCCESS) length = 0;
  std::snprintf(text, size, "%.*s (MPI error %d)", length, buffer, error);
}

}  // namespace
}  // namespace stgs::encoder

extern "C" __attribute__((visibility("default"))) const stgs::encoder::MpiFunctions*
stgs_mpi_functions_1() {
  using namespace stgs::encoder;
  static const MpiFunctions functions = {init,      gather_begin, gather_done, note_send,
                                         note_poll, finalize,     abort,       describe};
  return &functions;
}
