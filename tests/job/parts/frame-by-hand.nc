; frame around the display, written by hand
; origin in the middle of the part, z0 = glue height
g21 g90 g17
g64 p0.05
g0 z10
g0 x-40 y-25
g0 z0          ; down
f1200
g1 x40
g1 y25
g1 x-40
g1 y-25
g0 z10         ; up
g0 x0 y0
m2
