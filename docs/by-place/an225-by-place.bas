' Spiral inwards: two virtual axes run circles, the real ones follow with a ratio x that falls
ax=0: ay=1   ' real axes
cx=2: cy=3   ' virtual axes
outer=120: turns=4: pitch=10   ' mm
lasts=10   ' time of a pass at the outer diameter, ms
fall=2*pitch*(lasts/1000)/(PI*outer^2)   ' of the ratio, per pass and mm/s
' ratio x and path speed there, mm/s
TABLE(0,1,30)
TABLE(2,0.989583333333333,43.9)
TABLE(4,0.979166666666667,64.5)
TABLE(6,0.96875,94.2)
TABLE(8,0.958333333333333,100)
TABLE(10,0.395833333333333,100)
TABLE(12,0.385416666666667,91.5)
TABLE(14,0.375,73.2)
TABLE(16,0.364583333333333,58.5)
TABLE(18,0.354166666666667,46.8)
TABLE(20,0.34375,37.5)
TABLE(22,0.333333333333333,30)
TABLE(24,-1,30)
CONNECT(1,cx) AXIS(ax)
CONNECT(1,cy) AXIS(ay)
BASE(cx,cy)
ACCEL=4000
DECEL=4000
MERGE=ON
SPEED=30
n=1: x=1: i=0: due=0: TICKS=0
MOVECIRC(0,0,60,0,1)
REPEAT
  WHILE x<=TABLE(2*i+2)
    i=i+1
  WEND
  v=TABLE(2*i+1)+(TABLE(2*i)-x)/(TABLE(2*i)-TABLE(2*i+2))*(TABLE(2*i+3)-TABLE(2*i+1))
  IF x-fall*v>=1/65536 THEN x=x-fall*v
  SPEED=v/x   ' so that the real axes keep v
  IF n<turns AND NTYPE=0 THEN
    MOVECIRC(0,0,60,0,1)
    n=n+1
  ENDIF
  CONNECT(x,cx) AXIS(ax)
  CONNECT(x,cy) AXIS(ay)
  due=due-lasts*x
  WAIT UNTIL TICKS<=due OR MTYPE=0   ' TICKS of 1 ms, as at SERVO_PERIOD=1000
UNTIL MTYPE=0
CANCEL AXIS(ax)
CANCEL AXIS(ay)
