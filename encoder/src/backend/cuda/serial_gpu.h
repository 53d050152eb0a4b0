// SPDX-License-Identifier: Apache-2.0
// A GPU for the tasks of several threads, one at a time.
#pragma once

#include <mutex>
#include <string>

#include "backend/cuda/memory.h"

namespace stgs::encoder::cuda {

// Adds the remedy of users of --backend to an error of the GPU.
Status with_remedy(const Status& status);

// Waits also after an error or an exception, because copies use memory that is freed or written
// afterwards.
struct WaitAtEnd {
  const Stream& stream;
  ~WaitAtEnd() { (void)stream.wait(); }
};

// Thread-safe after create().
class SerialGpu {
 public:
  // Chooses GPU `gpu`. Errors are those of select_gpu().
  Status create(int gpu);
  // Returns "cuda (MODEL)".
  const std::string& name() const { return name_; }
  const Stream& stream() const { return stream_; }

  // Runs task(), which returns a Status, when no other task runs and with this GPU as that of the
  // calling thread. Waits for the stream. The error of the task, with a remedy.
  template <typename Task>
  Status run(const Task& task) {
    const std::lock_guard lock(mutex_);
    return with_remedy(run_alone(task));
  }

 private:
  template <typename Task>
  Status run_alone(const Task& task) {
    // The device is a setting of the thread.
    STGS_TRY(cuda_status(cudaSetDevice(index_), "choosing the GPU"));
    const WaitAtEnd wait{stream_};
    return task();
  }

  std::mutex mutex_;
  std::string name_;
  int index_ = 0;
  Stream stream_;
};

}  // namespace stgs::encoder::cuda
