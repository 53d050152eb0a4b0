// SPDX-License-Identifier: Apache-2.0
// Processes that train one scene together, each on other views, or windows of a long capture. They
// have the ranks 0 to size - 1 and are started by mpirun or by srun --mpi=pmix. All ranks make the
// same calls in the same order, each from one thread.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "stgs/format/status.h"

namespace stgs::encoder {

inline constexpr int kMaxRanks = 64;

class Ranks {
 public:
  virtual ~Ranks() = default;
  // Returns this process's rank, 0 to size() - 1.
  virtual int rank() const = 0;
  // Returns the number of ranks.
  virtual int size() const = 0;
  // Returns the rank among the ranks on this machine, from 0.
  virtual int node_rank() const = 0;
  // Returns the number of ranks on this machine, which share its memory and cores.
  virtual int node_size() const = 0;
  // Gathers `own` from every rank into `all` (size() x bytes), in rank order. `bytes` is a multiple
  // of 4 and equal on every rank. Blocks until all ranks have called; returns the error of another
  // rank if one fails.
  virtual Status all_gather(const void* own, std::size_t bytes, void* all) = 0;
  // Returns the error of another rank that has failed. Poll it while waiting for anything else.
  virtual Status check_peers() = 0;
};

// The part of this machine that a process uses if several processes of one run share it.
struct MachineShare {
  int index = 0;      // of the process among them; it uses this GPU, modulo the number of GPUs
  int processes = 1;  // their number; each uses this fraction of the available memory
};

// How this process was started, according to the environment.
struct Launch {
  int size = 1;          // processes started together
  std::string launcher;  // "mpirun" or "srun", for messages; "" if size is 1
};
// Reads the environment variables of mpirun and srun.
Launch detect_launch();

// Ranks started by mpirun or srun, connected by MPI. MPI is in the module stgs_mpi.so, which is
// loaded from the program's folder, so a program that was started alone does not need MPI.
class World : public Ranks {
 public:
  // The outcome that all ranks agree on.
  struct Conclusion {
    Status status;               // of the run: the lowest rank's own error, if any
    bool should_report = false;  // whether this rank reports it
  };

  // Returns whether this build has MPI.
  static bool is_built();
  // Connects the ranks; returns null if this process was started alone. kNotBuilt in a build
  // without MPI; kUnsupported if MPI cannot be loaded or does not see the other processes.
  static Result<std::unique_ptr<World>> join();

  // Ends this rank's work with its own status, good or bad. Sends the status to the other ranks,
  // which stop waiting for this one on an error, and blocks until theirs have arrived (a bounded
  // time after an error). Only finish() may follow.
  virtual Conclusion conclude(const Status& own) = 0;
  // Leaves MPI. If ranks hang or stopped in the middle of an exchange, aborts all of them with the
  // conclusion's exit code and does not return.
  virtual void finish() = 0;
};

}  // namespace stgs::encoder
