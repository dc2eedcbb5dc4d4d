// Written by `cargo xtask web`; changes are lost.

export const text = "fn Tah(Te:u32,T2:vec2<f32>,T0:u32)->vec4<f32>{let T58=(Te==1u)&(T3.Te1==1u);let T4=Tc(select(T3.Tk0,T3.Tk1,T58),T0);let at=T2*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Tx=floor(at);let Tv=T24(vec2<i32>(Tx),T4);let T1o=T53(Tv,T24(vec2<i32>(Tx)+vec2<i32>(1),T4),at-Tx);var a=vec4<f32>(0.0);if!T58{a=T3y(T8v,T1o,T0);}var b=a;if T58|(T3.T4k==T4m){b=T3y(Tdo,T1o,T0);}return T2f(select(a,b,T58),b,T3.T4k);}\n";
