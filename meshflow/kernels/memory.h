// Temporary memory of a kernel, released at the end of the scope.
#pragma once
#include <cstddef>
#include <cstdlib>

#include "interface.h"

namespace meshflow {

// n uninitialized elements of type A. Check with `if (!memory) return NO_MEMORY;`.
template <class A> class Memory {
  public:
    explicit Memory(i64 n) : at_(static_cast<A*>(std::malloc(n > 0 ? static_cast<std::size_t>(n) * sizeof(A) : 1))) {}
    ~Memory() { std::free(at_); }
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    explicit operator bool() const { return at_ != nullptr; }
    A* get() const { return at_; }
    A& operator[](i64 i) const { return at_[i]; }

  private:
    A* at_;
};

}  // namespace meshflow
