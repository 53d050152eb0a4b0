// SPDX-License-Identifier: Apache-2.0
// The interface of stgs_mpi.so: MPI behind plain C functions, so that the program itself does not
// link to an MPI. Only the module depends on a particular MPI and its ABI.
#pragma once

#include <cstddef>

namespace stgs::encoder {

// Call all functions from one thread. All except describe and abort return 0, or an MPI error code
// for describe.
struct MpiFunctions {
  int (*init)(int* rank, int* size, int* node_rank, int* node_size);
  // Starts a non-blocking all-gather, one at a time; `bytes` is a multiple of 4. MPI owns the
  // buffers until gather_done sets `done`.
  int (*gather_begin)(const void* own, std::size_t bytes, void* all);
  int (*gather_done)(int* done);
  // Sends a note to every other rank, on a separate communicator. `bytes` must remain valid and
  // unchanged until finalize.
  int (*note_send)(const void* bytes, std::size_t n);
  // Receives the next note, of n bytes; sets `from` to -1 if none has arrived.
  int (*note_poll)(int* from, void* bytes, std::size_t n);
  // Waits for all notes sent, then leaves MPI.
  int (*finalize)();
  // Aborts every rank with this exit code.
  void (*abort)(int code);
  // Writes the text of an MPI error code.
  void (*describe)(int error, char* text, std::size_t size);
};

// The module's only symbol; its number changes with MpiFunctions.
inline constexpr const char* kMpiSymbol = "stgs_mpi_functions_1";
using MpiSymbol = const MpiFunctions* (*)();

}  // namespace stgs::encoder
