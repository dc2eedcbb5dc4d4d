// Written by `cargo xtask web`; changes are lost.

export const text = "fn T9b(Th:u32,T3:vec2<f32>,T0:u32)->vec4<f32>{let T4q=(Th==1u)&(T2.Tcx==1u);let T4=Tb(select(T2.Tij,T2.Tik,T4q),T0);let at=T3*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Ts=floor(at);let Tq=T21(vec2<i32>(Ts),T4);let T1m=T4l(Tq,T21(vec2<i32>(Ts)+vec2<i32>(1),T4),at-Ts);var a=vec4<f32>(0.0);if!T4q{a=T3m(T7p,T1m,T0);}var b=a;if T4q|(T2.T45==T47){b=T3m(Tcl,T1m,T0);}return T28(select(a,b,T4q),b,T2.T45);}\n";
